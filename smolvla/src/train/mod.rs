//! Local training: the expert, fitted to samples.
//!
//! - [`options`]: how to train, LeRobot's preset by default.
//! - [`order`]: which samples a step takes and with what noise; functions of the seed and the step's number alone, so that a
//!   run is at every step fully described by its variables, its moments and that number.
//! - [`learner`]: the trainable variables and the loss of a batch, for either [`TrainScope`].
//! - [`trainer`]: makes steps.
//! - [`checkpoints`]: a run on disk, whole or not at all; a run that is stopped at any moment goes on from there and ends with
//!   the same bytes.
//! - [`measure`]: the loss that learning rates follow.
//! - [`split`]: episodes held out for evaluation.
//!
//! The same start, samples and options give the same bits on the same CPU.

pub mod checkpoints;
pub mod learner;
pub mod measure;
pub mod options;
pub mod order;
pub mod split;
pub mod trainer;

pub use learner::Samples;
pub use options::{TrainOptions, TrainScope};
pub use trainer::{Step, Trainer};

use crate::batch::InMemory;
use crate::config::PolicyConfig;
use crate::error::Result;
use crate::sample::PreparedSample;
use crate::weights::ExpertWeights;

/// What training gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Trained {
    /// The new weights.
    pub weights: ExpertWeights,
    /// The batch's loss before every step.
    pub losses: Vec<f32>,
}

/// Trains the expert from `start` on `samples`, by `loss_valid_only` with t = 0.999 Beta(1.5, 1) + 0.001, from the first step
/// to the last. `progress` is called after every step.
///
/// # Errors
/// [`PolicyError::Options`](crate::PolicyError::Options) and [`PolicyError::Sample`](crate::PolicyError::Sample) before the
/// first step; those of [`Trainer::step`].
pub fn train(
    config: &PolicyConfig,
    start: &ExpertWeights,
    samples: &[PreparedSample],
    options: &TrainOptions,
    progress: &mut dyn FnMut(Step),
) -> Result<Trained> {
    options.check()?;
    let samples = InMemory::new(config, samples)?;
    let mut trainer = Trainer::new(config, start, Samples::Prepared(&samples), options.clone())?;
    let mut losses = Vec::with_capacity(options.steps.min(1 << 20));
    while !trainer.is_done() {
        let step = trainer.step()?;
        losses.push(step.loss);
        progress(step);
    }
    Ok(Trained {
        weights: trainer.weights()?,
        losses,
    })
}
