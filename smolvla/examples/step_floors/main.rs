//! Where a training step's time goes: every kernel at the sizes that a step runs it with, against what this machine could do
//! at best. `step_floors tiny|micro|full BATCH` prints one JSON line a kernel, then their sum. The step is LeRobot's: pictures,
//! frozen half and all, and `state_proj` trained besides the expert.
//!
//! A kernel's floor is the longer of two: its floating-point operations at the rate of a large product that stays in the
//! cache, and the bytes that it has to move at the rate of copying memory. Both rates are measured first. What is left out takes
//! no time at any size: embeddings of words and times, masks, the loss.

mod attending;
mod linear;
mod passes;
mod report;

use std::collections::BTreeMap;

use candle_core::Var;
use report::{tensor, Least, Report};
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::layout::trainable_layout;
use zk0_smolvla::policy::memory::KeepFreed;
use zk0_smolvla::policy::profile::Profile;
use zk0_smolvla::train::optimizer::{AdamW, AdamWOptions, Optimizer};

/// The allocator is that of the `zk0` binary.
#[global_allocator]
static ALLOCATOR: zk0_smolvla::policy::memory::Allocator = zk0_smolvla::policy::memory::Allocator;

type Failure = Box<dyn std::error::Error>;

/// Clipping reads the gradient. The step then reads the gradient, the weight and both moments, and writes all but the gradient.
fn optimizer(report: &mut Report, c: &PolicyConfig) -> Result<(), Failure> {
    let layout = trainable_layout(c, true);
    let trained = layout.values().map(|shape| shape.iter().product::<usize>());
    let trained = trained.sum();
    let variable = Var::from_tensor(&tensor(&[trained])?)?;
    let variables = BTreeMap::from([("weights".to_owned(), variable.clone())]);
    let mut optimizer = AdamW::new(&variables, AdamWOptions::default())?;
    let gradients = variable.as_tensor().sum_all()?.backward()?;
    report.kernel("clipping and AdamW", 1, Least::moving(8 * trained), || {
        optimizer
            .step(&gradients, 1e-4)
            .map(|_| ())
            .expect("a gradient is there");
    });
    Ok(())
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [profile, batch] = arguments.as_slice() else {
        return Err("usage: step_floors tiny|micro|full BATCH".into());
    };
    let c = Profile::from_name(profile)?.config();
    let batch: usize = batch.parse()?;
    let _memory = KeepFreed::new();
    let mut report = Report::begin();
    passes::pictures(&mut report, &c, batch)?;
    linear::linear_maps(&mut report, &c, batch)?;
    attending::attention(&mut report, &c, batch)?;
    passes::vision(&mut report, &c, batch)?;
    passes::language_and_expert(&mut report, &c, batch)?;
    optimizer(&mut report, &c)?;
    report.end();
    Ok(())
}
