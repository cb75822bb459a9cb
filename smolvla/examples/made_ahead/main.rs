//! Times training on a recording of which no sample is kept: each is made for the step that takes it, as it is for frames that do not
//! fit into the prefix cache. Prints one JSON line per run: `made_ahead RECORDING PROFILE BATCH STEPS [RUNS]`.
//!
//! Runs alternate between two ways: `in-turn` makes each sample when the step asks for it, and `ahead` makes samples in the background
//! while a step runs, as `zk0 train` and nodes do. The program fails if the two ways give different weights.

use std::time::Instant;

use zk0_lerobot::dataset::Dataset;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::prefix_cache::{FileDigests, FrameMaker, FrameRef, FrameSource, KeySpace};
use zk0_smolvla::frames::sample::{PreparedSample, Preparer};
use zk0_smolvla::policy::device::Device;
use zk0_smolvla::policy::frozen::FrozenPlace;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::profile::Profile;
use zk0_smolvla::policy::tokenizer::WordHash;
use zk0_smolvla::train::{train_on, TrainOptions, Trainer, TrainingSamples};
use zk0_smolvla::{ExpertWeights, Policy};

/// The allocator is that of the `zk0` binary.
#[global_allocator]
static ALLOCATOR: zk0_smolvla::policy::memory::Allocator = zk0_smolvla::policy::memory::Allocator;

type Failure = Box<dyn std::error::Error>;

/// Makes each sample when a step asks for it.
fn in_turn(
    policy: &Policy,
    source: &dyn SampleSource<PreparedSample>,
    options: &TrainOptions,
) -> Result<ExpertWeights, Failure> {
    let samples = TrainingSamples::Prepared(source);
    let mut trainer = Trainer::new(&policy.config, &policy.expert, samples, options.clone())?;
    while !trainer.is_done() {
        trainer.step()?;
    }
    Ok(trainer.weights()?)
}

/// Makes samples in the background.
fn ahead(
    policy: &Policy,
    source: &dyn SampleSource<PreparedSample>,
    options: &TrainOptions,
) -> Result<ExpertWeights, Failure> {
    let (config, start) = (&policy.config, &policy.expert);
    let (device, samples) = (&Device::Cpu, TrainingSamples::Prepared(source));
    let trained = train_on(device, config, start, samples, options, None, &mut |_| ())?;
    Ok(trained.weights)
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [recording, profile, batch, steps, runs @ ..] = arguments.as_slice() else {
        return Err("usage: made_ahead RECORDING tiny|micro|full BATCH STEPS [RUNS]".into());
    };
    let runs = runs.first().map_or(Ok(3), |runs| runs.parse())?;
    let policy = init_policy(&Profile::from_name(profile)?.config(), 1)?;
    let tokenizer = WordHash::new(&policy.config);
    let datasets = [Dataset::open(recording)?];
    let all: Vec<usize> = (0..datasets[0].len()).collect();
    let space = KeySpace::new::<PreparedSample>(&policy, &FrozenPlace::default());
    let mut files = FileDigests::default();
    let keys = space.keys(&policy.config, &tokenizer, &datasets[0], &all, &mut files)?;
    let frames = keys.into_iter().zip(all).map(|(key, index)| FrameRef {
        dataset: 0,
        index,
        key,
        transformed: false,
    });
    let maker = FrameMaker::new(&datasets, policy.config.chunk_size, || {
        Preparer::new(&policy, &tokenizer)
    });
    let source = FrameSource::<PreparedSample>::new(None, &maker, frames.collect());
    let options = TrainOptions {
        steps: steps.parse()?,
        batch_size: batch.parse()?,
        ..TrainOptions::default()
    };
    // The frozen half is loaded before the clock starts.
    source.sample(0)?;
    let mut expected: Option<ExpertWeights> = None;
    for _ in 0..runs {
        for (what, train) in [("in-turn", in_turn as Way), ("ahead", ahead)] {
            let started = Instant::now();
            let weights = train(&policy, &source, &options)?;
            let seconds = started.elapsed().as_secs_f64();
            if expected.get_or_insert_with(|| weights.clone()) != &weights {
                return Err(format!("{what}: other weights than the run before").into());
            }
            println!(
                "{}",
                serde_json::json!({
                    "bench": "made-ahead", "what": what, "profile": profile, "batch": options.batch_size,
                    "steps": options.steps, "step_seconds": seconds / options.steps as f64,
                })
            );
        }
    }
    Ok(())
}

/// A way to train.
type Way =
    fn(&Policy, &dyn SampleSource<PreparedSample>, &TrainOptions) -> Result<ExpertWeights, Failure>;
