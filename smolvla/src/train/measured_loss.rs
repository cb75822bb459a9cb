//! The loss that learning rates follow.

use zk0_lerobot::config::PolicyConfig;

use crate::error::{PolicyError, Result};
use crate::measure::evaluate::fixed_draws;
use crate::policy::frozen::FrozenPlace;
use crate::policy::weights::ExpertWeights;
use crate::train::learner::{EvaluationModels, TrainingSamples};
use crate::train::trainer::evaluate_samples;

/// Most samples.
const MEASURED: usize = 256;

/// The `loss_valid_only` of `models` on at most 256 evenly spaced `samples`, with noise and times from `seed`.
///
/// # Errors
/// [`PolicyError::Sample`] for no samples, or one that does not fit.
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

/// As [`measured_loss`], from weights, on the CPU.
///
/// # Errors
/// Those of [`measured_loss`].
pub fn loss_of(
    config: &PolicyConfig,
    weights: &ExpertWeights,
    samples: TrainingSamples,
    seed: u64,
) -> Result<f64> {
    let models = EvaluationModels::new(config, weights, None, &FrozenPlace::default())?;
    measured_loss(&models, samples, seed)
}
