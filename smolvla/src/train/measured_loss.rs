//! The loss that learning rates follow: on a fixed part of the samples, at fixed noise and times.

use zk0_lerobot::config::PolicyConfig;

use crate::error::{PolicyError, Result};
use crate::measure::evaluate::fixed_draws;
use crate::policy::frozen::FrozenPlace;
use crate::policy::weights::ExpertWeights;
use crate::train::learner::{EvaluationModels, TrainingSamples};
use crate::train::trainer::evaluate_samples;

/// Samples that a loss is measured on, at most.
const MEASURED: usize = 256;

/// The `loss_valid_only` of `models` on at most 256 of `samples`, evenly spaced, at a noise and time each that follow from
/// `seed`. Comparable between weights, for the same samples and seed.
///
/// # Errors
/// [`PolicyError::Sample`] when there is no sample, or one cannot be had or does not fit the policy.
pub fn measured_loss(
    models: &EvaluationModels,
    samples: TrainingSamples,
    seed: u64,
) -> Result<f64> {
    let (len, count) = (samples.len(), samples.len().min(MEASURED));
    let indices: Vec<usize> = (0..count).map(|i| i * len / count).collect();
    let draws = fixed_draws(models.config(), count, seed);
    let errors = evaluate_samples(models, samples, &indices, &draws)?;
    let loss = errors.valid_only.loss();
    if loss.is_finite() {
        Ok(loss)
    } else {
        Err(PolicyError::Sample(format!(
            "the loss on {count} of them is {loss}"
        )))
    }
}

/// As [`measured_loss`], of weights, on the CPU.
///
/// # Errors
/// As [`measured_loss`].
pub fn loss_of(
    config: &PolicyConfig,
    weights: &ExpertWeights,
    samples: TrainingSamples,
    seed: u64,
) -> Result<f64> {
    let models = EvaluationModels::new(config, weights, None, &FrozenPlace::default())?;
    measured_loss(&models, samples, seed)
}
