//! The flow-matching loss at given noise and times: a claim's float32 side.

use std::iter::Sum;

use candle_core::{Device, Tensor};
use rand::{RngCore, SeedableRng};
use rand_chacha::ChaCha20Rng;
use zk0_lerobot::config::PolicyConfig;

use crate::error::{PolicyError, Result};
use crate::frames::batch::Batch;
use crate::frames::sample::PreparedSample;
use crate::policy::model::expert::ExpertModel;
use crate::policy::model::flow::{losses, noisy_actions, target_velocity};
use crate::policy::model::observe::{ignore, Observer};
use crate::policy::model::PolicyParameters;
use crate::policy::random::{flow_time, normal};
use crate::policy::weights::ExpertWeights;

const BATCH: usize = 64;

/// The random part of one loss evaluation.
#[derive(Clone, Debug, PartialEq)]
pub struct FlowDraw {
    /// Flow time in [0, 1].
    pub time: f32,
    /// (chunk_size, max_action_dim), standard normal.
    pub noise: Vec<f32>,
}

impl FlowDraw {
    /// A draw as in training.
    pub fn random(config: &PolicyConfig, rng: &mut impl RngCore) -> Self {
        let time = flow_time(rng);
        Self {
            time,
            noise: (0..config.chunk_elements()).map(|_| normal(rng)).collect(),
        }
    }
}

/// `count` draws from a seed.
pub fn fixed_draws(config: &PolicyConfig, count: usize, seed: u64) -> Vec<FlowDraw> {
    let mut rng = ChaCha20Rng::seed_from_u64(seed);
    (0..count)
        .map(|_| FlowDraw::random(config, &mut rng))
        .collect()
}

/// A loss, as a sum and a count.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LossTotal {
    /// Sum of squared errors over the real action dimensions of frames that are not padding.
    pub squared_error: f64,
    /// The number of terms.
    pub elements: usize,
}

impl LossTotal {
    fn of(errors: &[f32]) -> Self {
        Self {
            squared_error: errors.iter().map(|e| f64::from(*e)).sum(),
            elements: errors.len(),
        }
    }

    /// The `loss_valid_only` of all samples.
    pub fn loss(&self) -> f64 {
        self.squared_error / self.elements.max(1) as f64
    }
}

impl Sum for LossTotal {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::default(), |sum, one| Self {
            squared_error: sum.squared_error + one.squared_error,
            elements: sum.elements + one.elements,
        })
    }
}

/// Evaluates `weights` on samples, each with its draw.
///
/// # Errors
/// [`PolicyError::Sample`] for a sample or draw that does not fit.
pub fn evaluate(
    config: &PolicyConfig,
    weights: &ExpertWeights,
    pairs: &[(&PreparedSample, &FlowDraw)],
) -> Result<LossTotal> {
    Ok(evaluate_each(config, weights, pairs, &mut ignore)?
        .into_iter()
        .sum())
}

/// Each pair's evaluation in order, watched by `observe`.
///
/// # Errors
/// Those of [`evaluate`] and `observe`.
pub fn evaluate_each(
    config: &PolicyConfig,
    weights: &ExpertWeights,
    pairs: &[(&PreparedSample, &FlowDraw)],
    observe: &mut Observer,
) -> Result<Vec<LossTotal>> {
    let device = Device::Cpu;
    let expert = ExpertModel::new(config, &PolicyParameters::load(weights.tensors(), &device)?)?;
    let mut all = Vec::with_capacity(pairs.len());
    for (round, some) in pairs.chunks(BATCH).enumerate() {
        let samples: Vec<&PreparedSample> = some.iter().map(|(sample, _)| *sample).collect();
        let draws: Vec<&FlowDraw> = some.iter().map(|(_, draw)| *draw).collect();
        let numbers: Vec<usize> = (round * BATCH..).take(some.len()).collect();
        let batch = Batch::new(config, &samples, &numbers, &device)?;
        let errors = squared_errors(config, &expert, &batch, &draws, observe)?;
        all.extend(errors.iter().map(|errors| errors.valid_only));
    }
    Ok(all)
}

/// A sample's squared errors, for both LeRobot means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleErrors {
    /// Real action dimensions of frames that are not padding: LeRobot 0.6's `loss_valid_only`, as in a claim.
    pub valid_only: LossTotal,
    /// All dimensions and frames, with padding: LeRobot 0.4's.
    pub plain: LossTotal,
}

/// The errors of each sample of a batch at its draw.
///
/// # Errors
/// [`PolicyError::Sample`] for a draw that does not fit; those of `observe`.
pub fn squared_errors(
    config: &PolicyConfig,
    expert: &ExpertModel,
    batch: &Batch,
    draws: &[&FlowDraw],
    observe: &mut Observer,
) -> Result<Vec<SampleErrors>> {
    if draws.len() != batch.is_pad.len() {
        return Err(PolicyError::Sample(format!(
            "{} draws for {} samples",
            draws.len(),
            batch.is_pad.len()
        )));
    }
    for draw in draws {
        check(config, draw)?;
    }
    let errors: Vec<f32> = losses_at(expert, batch, draws, observe)?
        .flatten_all()?
        .to_vec1()?;
    let samples = errors.chunks_exact(config.chunk_elements());
    let each = samples.zip(&batch.is_pad).map(|(errors, is_pad)| {
        let frames = errors.chunks_exact(config.max_action_dim).zip(is_pad);
        let real = frames.filter(|(_, pad)| !**pad);
        SampleErrors {
            valid_only: real
                .map(|(frame, _)| LossTotal::of(&frame[..config.action_dim]))
                .sum(),
            plain: LossTotal::of(errors),
        }
    });
    Ok(each.collect())
}

/// Squared errors of a batch's action elements, each sample at its draw.
///
/// # Errors
/// Those of `observe`.
pub fn losses_at(
    expert: &ExpertModel,
    batch: &Batch,
    draws: &[&FlowDraw],
    observe: &mut Observer,
) -> Result<Tensor> {
    let times: Vec<f32> = draws.iter().map(|draw| draw.time).collect();
    let noise: Vec<f32> = draws.iter().flat_map(|d| d.noise.iter().copied()).collect();
    let noise = Tensor::from_vec(noise, batch.actions.shape(), batch.actions.device())?;
    let x_t = noisy_actions(&batch.actions, &noise, &times)?;
    let velocity = expert.forward_observed(&batch.cache, &x_t, &times, observe)?;
    losses(&velocity, &target_velocity(&batch.actions, &noise)?)
}

fn check(config: &PolicyConfig, draw: &FlowDraw) -> Result<()> {
    if draw.noise.len() != config.chunk_elements() || !draw.noise.iter().all(|x| x.is_finite()) {
        return Err(PolicyError::Sample(format!(
            "a draw needs {} finite noise values",
            config.chunk_elements()
        )));
    }
    if !(0.0..=1.0).contains(&draw.time) {
        return Err(PolicyError::Sample(format!(
            "flow time {} is not in [0, 1]",
            draw.time
        )));
    }
    Ok(())
}
