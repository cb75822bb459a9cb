//! Normalisers of states and actions, and their moments.

use serde::{Deserialize, Serialize};

use crate::dataset::metadata::json;

/// Normalisers of states and actions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stats {
    /// For `observation.state`.
    pub state: Normalizer,
    /// For `action`.
    pub action: Normalizer,
}

/// `(x - mean) / (std + 1e-8)` per dimension, in float32 as LeRobot computes it, and back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "MeanAndStd", into = "MeanAndStd")]
pub struct Normalizer {
    mean: Vec<f32>,
    std: Vec<f32>,
}

/// Per dimension, as files have them.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct MeanAndStd {
    #[serde(deserialize_with = "json::numbers")]
    pub mean: Vec<f64>,
    #[serde(deserialize_with = "json::numbers")]
    pub std: Vec<f64>,
}

impl Stats {
    /// The normaliser of several recordings, each with its number of frames, pooled as LeRobot's `aggregate_stats` does; one is its own.
    /// `None` without frames, or where dimensions differ.
    pub fn pooled(recordings: &[(&Self, usize)]) -> Option<Self> {
        if let [(one, _)] = recordings {
            return Some((*one).clone());
        }
        let pooled = |of: fn(&Self) -> &Normalizer| {
            let dim = of(recordings.first()?.0).dim();
            let moments: Vec<MeanAndStd> = recordings.iter().map(|(s, _)| of(s).into()).collect();
            if moments.iter().any(|m| m.mean.len() != dim) {
                return None;
            }
            let frames = recordings.iter().map(|(_, frames)| *frames as f64);
            let parts: Vec<_> = moments.iter().zip(frames).collect();
            Normalizer::of(&pool(&parts, dim), dim).ok()
        };
        Some(Self {
            state: pooled(|s| &s.state)?,
            action: pooled(|s| &s.action)?,
        })
    }
}

/// Moments of all frames, from parts of `dim` dimensions, each with its number of frames.
///
/// With n frames in a part of mean m and standard deviation s, the whole has mean M = sum(n m) / sum(n) and
/// variance sum(n (s² + (m - M)²)) / sum(n).
pub(crate) fn pool(parts: &[(&MeanAndStd, f64)], dim: usize) -> MeanAndStd {
    let total: f64 = parts.iter().map(|(_, count)| count).sum();
    let weighted = |value: &dyn Fn(&MeanAndStd) -> f64| {
        let values = parts.iter().map(|(moments, count)| value(moments) * count);
        values.sum::<f64>() / total
    };
    let mean: Vec<f64> = (0..dim).map(|d| weighted(&|m| m.mean[d])).collect();
    let variance = |d: usize| {
        let spread = |m: &MeanAndStd| m.std[d].powi(2) + (m.mean[d] - mean[d]).powi(2);
        weighted(&spread)
    };
    let std = (0..dim).map(|d| variance(d).sqrt()).collect();
    MeanAndStd { mean, std }
}

impl From<&Normalizer> for MeanAndStd {
    fn from(normalizer: &Normalizer) -> Self {
        let f64s = |values: &[f32]| values.iter().map(|&v| v.into()).collect();
        Self {
            mean: f64s(&normalizer.mean),
            std: f64s(&normalizer.std),
        }
    }
}

// An f64 returns every f32 exactly.
impl From<Normalizer> for MeanAndStd {
    fn from(normalizer: Normalizer) -> Self {
        Self::from(&normalizer)
    }
}

impl TryFrom<MeanAndStd> for Normalizer {
    type Error = String;

    fn try_from(moments: MeanAndStd) -> Result<Self, String> {
        Self::of(&moments, moments.mean.len())
    }
}

impl Normalizer {
    pub(crate) fn of(moments: &MeanAndStd, dim: usize) -> Result<Self, String> {
        let MeanAndStd { mean, std } = moments;
        if mean.len() != dim || std.len() != dim {
            return Err(format!(
                "{} means and {} standard deviations for {dim} dimensions",
                mean.len(),
                std.len()
            ));
        }
        let f32s = |values: &[f64]| -> Vec<f32> { values.iter().map(|&v| v as f32).collect() };
        let (mean, std) = (f32s(mean), f32s(std));
        let not_finite = |value: &f32| !value.is_finite();
        if let Some(at) = mean.iter().position(not_finite) {
            return Err(format!(
                "mean {at} is {}, which is no finite number",
                mean[at]
            ));
        }
        if let Some(at) = std.iter().position(|v| not_finite(v) || *v < 0.0) {
            let value = std[at];
            return Err(format!(
                "standard deviation {at} is {value}; it has to be a finite number, 0 or above"
            ));
        }
        Self::new(mean, std).ok_or_else(|| "has no dimensions".into())
    }

    /// From mean and standard deviation per dimension; `None` where lengths differ or are 0, a value is not finite, or a deviation is
    /// negative.
    pub fn new(mean: Vec<f32>, std: Vec<f32>) -> Option<Self> {
        let fits = !mean.is_empty()
            && mean.len() == std.len()
            && mean.iter().chain(&std).all(|v| v.is_finite())
            && std.iter().all(|&v| v >= 0.0);
        fits.then_some(Self { mean, std })
    }

    /// The one that changes nothing; `None` for `dim` 0.
    pub fn identity(dim: usize) -> Option<Self> {
        Self::new(vec![0.0; dim], vec![1.0; dim])
    }

    /// Number of dimensions.
    pub fn dim(&self) -> usize {
        self.mean.len()
    }

    /// Mean per dimension.
    pub fn mean(&self) -> &[f32] {
        &self.mean
    }

    /// Standard deviation per dimension.
    pub fn std(&self) -> &[f32] {
        &self.std
    }

    /// Normalises rows of [`Normalizer::dim`] values in place.
    pub fn normalize(&self, rows: &mut [f32]) {
        for row in rows.chunks_mut(self.dim()) {
            for ((x, mean), std) in row.iter_mut().zip(&self.mean).zip(&self.std) {
                *x = (*x - mean) / (std + 1e-8);
            }
        }
    }

    /// Denormalises rows to the robot's units in place.
    pub fn denormalize(&self, rows: &mut [f32]) {
        for row in rows.chunks_mut(self.dim()) {
            for ((x, mean), std) in row.iter_mut().zip(&self.mean).zip(&self.std) {
                *x = *x * std + mean;
            }
        }
    }
}
