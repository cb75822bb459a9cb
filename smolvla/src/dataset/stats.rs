//! `meta/stats.json` and the normalisation SmolVLA trains with: mean 0, standard deviation 1.

use std::collections::HashMap;
use std::path::Path;

use serde::Deserialize;

use super::info::{read_json_text, ACTION, STATE};
use super::{DatasetError, Info};

/// Normalisers of the recording's states and actions.
#[derive(Debug, Clone)]
pub struct Stats {
    /// For `observation.state`.
    pub state: Normalizer,
    /// For `action`.
    pub action: Normalizer,
}

/// `(x - mean) / (std + 1e-8)` per dimension, in float32 as LeRobot computes it, and back.
#[derive(Debug, Clone, PartialEq)]
pub struct Normalizer {
    mean: Vec<f32>,
    std: Vec<f32>,
}

#[derive(Deserialize)]
struct RawStats {
    mean: Vec<f64>,
    std: Vec<f64>,
}

impl Stats {
    /// Reads and checks `meta/stats.json` under `root`.
    pub(super) fn read(root: &Path, info: &Info) -> Result<Self, DatasetError> {
        let path = root.join("meta/stats.json");
        let text = read_json_text(&path)?;
        let broken = |cause: String| DatasetError::meta(&path, cause);
        // Images' statistics are nested differently and not used: take only what is.
        let mut all: HashMap<String, serde_json::Value> = serde_json::from_str(&text)
            .map_err(|e| broken(format!("is not the JSON it should be: {e}")))?;
        let mut normalizer = |name: &str, dim: usize| {
            let value = all
                .remove(name)
                .ok_or_else(|| broken(format!("has no statistics of {name}")))?;
            let raw: RawStats =
                serde_json::from_value(value).map_err(|e| broken(format!("{name}: {e}")))?;
            if raw.mean.len() != dim || raw.std.len() != dim {
                return Err(broken(format!(
                    "{name}: {} means and {} standard deviations for {dim} dimensions",
                    raw.mean.len(),
                    raw.std.len()
                )));
            }
            let f32s = |values: Vec<f64>| values.into_iter().map(|v| v as f32).collect();
            Normalizer::new(f32s(raw.mean), f32s(raw.std)).ok_or_else(|| {
                broken(format!(
                    "{name}: a mean or standard deviation is not a finite number, or below 0"
                ))
            })
        };
        Ok(Self {
            state: normalizer(STATE, info.state.dim)?,
            action: normalizer(ACTION, info.action.dim)?,
        })
    }
}

impl Normalizer {
    /// From one mean and one standard deviation per dimension; `None` where lengths differ or are 0, or a value is not
    /// finite, or a standard deviation is negative.
    pub fn new(mean: Vec<f32>, std: Vec<f32>) -> Option<Self> {
        let fits = !mean.is_empty()
            && mean.len() == std.len()
            && mean.iter().chain(&std).all(|v| v.is_finite())
            && std.iter().all(|&v| v >= 0.0);
        fits.then_some(Self { mean, std })
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

    /// Brings rows of normalised values back to the robot's units, in place.
    pub fn denormalize(&self, rows: &mut [f32]) {
        for row in rows.chunks_mut(self.dim()) {
            for ((x, mean), std) in row.iter_mut().zip(&self.mean).zip(&self.std) {
                *x = *x * std + mean;
            }
        }
    }
}
