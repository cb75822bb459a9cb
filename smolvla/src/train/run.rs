//! Trains from the first step to the last.

use candle_core::Device;
use zk0_lerobot::config::PolicyConfig;
use zk0_tensors::TensorSet;

use crate::error::Result;
use crate::frames::batch::SamplesInMemory;
use crate::frames::sample::PreparedSample;
use crate::policy::frozen::FrozenPlace;
use crate::policy::weights::ExpertWeights;
use crate::train::learner::TrainingSamples;
use crate::train::optimizer::Optimizer;
use crate::train::options::TrainOptions;
use crate::train::trainer::{FedCm, Trainer, TrainingStep};

/// The result of training.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingResult {
    /// The new weights.
    pub weights: ExpertWeights,
    /// Each batch's loss before its step.
    pub losses: Vec<f32>,
}

/// As [`train_on`], on samples in memory, all checked first.
///
/// # Errors
/// [`PolicyError::Options`](crate::PolicyError::Options) and [`PolicyError::Sample`](crate::PolicyError::Sample) before the first step;
/// those of [`Trainer::step`].
pub fn train(
    config: &PolicyConfig,
    start: &ExpertWeights,
    samples: &[PreparedSample],
    options: &TrainOptions,
    progress: &mut dyn FnMut(TrainingStep),
) -> Result<TrainingResult> {
    options.check()?;
    let samples = SamplesInMemory::new(config, samples)?;
    let samples = TrainingSamples::Prepared(&samples);
    train_on(
        &Device::Cpu,
        config,
        start,
        samples,
        options,
        None,
        progress,
    )
}

/// Trains the expert on `device` from `start` on `samples`, by `loss_valid_only` with t = 0.999 Beta(1.5, 1) + 0.001. With `fedcm`, steps
/// follow the last global step in part. `progress` is called after every step. Memory holds one step's samples, and the next one's if [made
/// ahead](crate::frames::ahead).
///
/// # Errors
/// Those of [`Trainer::new`] and [`Trainer::step`].
pub fn train_on(
    device: &Device,
    config: &PolicyConfig,
    start: &ExpertWeights,
    samples: TrainingSamples,
    options: &TrainOptions,
    fedcm: Option<FedCm<'_>>,
    progress: &mut dyn FnMut(TrainingStep),
) -> Result<TrainingResult> {
    let place = place(device);
    samples.ahead(|samples| {
        let mut trainer = Trainer::on(&place, config, start, None, samples, options.clone())?;
        if let Some(fedcm) = fedcm {
            trainer.follow(&fedcm)?;
        }
        all_steps(trainer, progress)
    })
}

/// As [`train_on`], but by SGD with SCAFFOLD's `correction` of gradients.
///
/// # Errors
/// Those of [`Trainer::by_sgd`] and [`Trainer::step`].
pub fn train_by_sgd(
    device: &Device,
    config: &PolicyConfig,
    start: &ExpertWeights,
    samples: TrainingSamples,
    options: &TrainOptions,
    correction: Option<&TensorSet>,
    progress: &mut dyn FnMut(TrainingStep),
) -> Result<TrainingResult> {
    let (place, options) = (place(device), options.clone());
    samples.ahead(|samples| {
        let trainer = Trainer::by_sgd(&place, config, start, samples, options, correction)?;
        all_steps(trainer, progress)
    })
}

/// Prepared samples come from the CPU.
fn place(device: &Device) -> FrozenPlace {
    FrozenPlace {
        device: device.clone(),
        ..FrozenPlace::default()
    }
}

fn all_steps<O: Optimizer>(
    mut trainer: Trainer<'_, O>,
    progress: &mut dyn FnMut(TrainingStep),
) -> Result<TrainingResult> {
    let mut losses = Vec::with_capacity(trainer.options().steps.min(1 << 20));
    while !trainer.is_done() {
        let step = trainer.step()?;
        losses.push(step.loss);
        progress(step);
    }
    Ok(TrainingResult {
        weights: trainer.weights()?,
        losses,
    })
}
