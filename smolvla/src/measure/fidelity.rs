//! The fixed-point loss against the float32 loss on the same inputs, and the ranges' headroom.

use zk0_circuits::model::draw::draw;
use zk0_circuits::model::eval::{Evaluator, Overflow};
use zk0_circuits::model::quantise::QuantiseError;
use zk0_circuits::model::site::EvalError;
use zk0_circuits::model::spec::SpecError;
use zk0_circuits::{Digest, EvalSpec};
use zk0_lerobot::config::PolicyConfig;

use crate::error::PolicyError;
use crate::frames::sample::PreparedSample;
use crate::measure::calibrate::{ranges, CalibrationPoint, Magnitudes, ObservedRange};
use crate::measure::evaluate::{FlowDraw, LossTotal};
use crate::measure::fixed_point::{quantise_sample, quantise_weights};
use crate::policy::weights::ExpertWeights;

/// Both losses, and the ranges of their passes.
#[derive(Clone, Debug, PartialEq)]
pub struct Fidelity {
    /// Evaluations, each with its own time and noise.
    pub evaluations: usize,
    /// Mean loss in float32.
    pub float32_loss: f64,
    /// Mean loss in fixed point, as in a claim.
    pub fixed_point_loss: f64,
    /// The largest relative difference in one evaluation.
    pub worst_sample: f64,
    /// Each place's range, and what float32 passes reached.
    pub ranges: Vec<ObservedRange>,
}

impl Fidelity {
    /// Relative difference of the mean losses.
    pub fn relative_difference(&self) -> f64 {
        (self.fixed_point_loss / self.float32_loss - 1.0).abs()
    }

    /// The range with the least headroom, without noise and time embedding.
    pub fn tightest(&self) -> Option<&ObservedRange> {
        let bounded = |range: &&ObservedRange| {
            matches!(
                range.place,
                CalibrationPoint::Noise | CalibrationPoint::TimeEmbedding
            )
        };
        let by_headroom =
            |a: &&ObservedRange, b: &&ObservedRange| a.headroom().total_cmp(&b.headroom());
        let ranges = self.ranges.iter().filter(|range| !bounded(range));
        ranges.min_by(by_headroom)
    }
}

/// Why losses cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum FidelityError {
    /// The float32 side.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// The specification.
    #[error(transparent)]
    Spec(#[from] SpecError),
    /// A sample or weight does not fit.
    #[error(transparent)]
    Quantise(#[from] QuantiseError),
    /// [`EvalError::OutOfRange`] names the place.
    #[error(transparent)]
    Evaluation(#[from] EvalError),
}

/// The draws of `count` evaluations under a challenge, exact in fixed point.
pub fn draws(spec: &EvalSpec, challenge: &Digest, count: usize) -> Vec<FlowDraw> {
    let unit = 1.0 / f32::from(1u16 << spec.action.min(15));
    (0..count as u32)
        .map(|position| {
            let draw = draw(spec, challenge, position, count as u32);
            FlowDraw {
                time: f32::from(draw.time) / 65536.0,
                noise: draw.noise.iter().map(|n| f32::from(*n) * unit).collect(),
            }
        })
        .collect()
}

/// Evaluates `weights` in float32, without rounding, and in fixed point `count` times, on the samples in turn, with successive draws of
/// `challenge`.
///
/// # Errors
/// There is no sample, `spec` has other dimensions, or a value does not fit.
pub fn measure(
    spec: &EvalSpec,
    config: &PolicyConfig,
    weights: &ExpertWeights,
    samples: &[PreparedSample],
    challenge: &Digest,
    count: usize,
) -> Result<Fidelity, FidelityError> {
    let evaluator = Evaluator::new(spec)?;
    if samples.is_empty() || count == 0 {
        return Err(PolicyError::Sample("there is nothing to evaluate".into()).into());
    }
    let draws = draws(spec, challenge, count);
    let pairs: Vec<_> = samples.iter().cycle().zip(&draws).collect();
    let (magnitudes, float32) = Magnitudes::observe(config, weights, &pairs)?;

    let quantised = quantise_weights(spec, weights)?;
    let mut products = evaluator.direct(&quantised, Overflow::Refused)?;
    let unit = 2f64.powi(-2 * i32::from(spec.action));
    let mut fixed = Vec::with_capacity(count);
    for (position, (sample, _)) in pairs.iter().enumerate() {
        let sample = quantise_sample(spec, sample)?;
        let draw = draw(spec, challenge, position as u32, count as u32);
        let sum = evaluator.loss(&mut products, &sample, &draw)?;
        fixed.push(LossTotal {
            squared_error: sum.squared_error as f64 * unit,
            elements: sum.elements as usize,
        });
    }
    let differences = fixed.iter().zip(&float32);
    let differences = differences.map(|(a, b)| (a.loss() / b.loss() - 1.0).abs());
    Ok(Fidelity {
        evaluations: count,
        float32_loss: float32.iter().copied().sum::<LossTotal>().loss(),
        fixed_point_loss: fixed.iter().copied().sum::<LossTotal>().loss(),
        worst_sample: differences.fold(0.0, f64::max),
        ranges: ranges(spec, &magnitudes),
    })
}
