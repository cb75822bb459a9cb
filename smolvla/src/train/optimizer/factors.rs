//! Settings, and the numbers shared by a step's tensors.

use serde::{Deserialize, Serialize};

/// Settings besides the learning rate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AdamWOptions {
    /// Decay of the mean gradient.
    pub beta1: f64,
    /// Decay of the mean squared gradient.
    pub beta2: f64,
    /// Added to the root of the mean squared gradient.
    pub eps: f64,
    /// Decoupled weight decay.
    pub weight_decay: f64,
    /// Limit of the gradients' L2 norm.
    pub clip_norm: f64,
}

impl Default for AdamWOptions {
    /// LeRobot's preset for SmolVLA.
    fn default() -> Self {
        Self {
            beta1: 0.9,
            beta2: 0.95,
            eps: 1e-8,
            weight_decay: 1e-10,
            clip_norm: 10.0,
        }
    }
}

#[derive(Clone, Copy, Default)]
pub(super) struct Squares {
    /// Of the gradient with its proximal part.
    pub gradient: f64,
    /// Of the distance from the start.
    pub distance: f64,
}

impl Squares {
    pub fn add(&mut self, more: Self) {
        self.gradient += more.gradient;
        self.distance += more.distance;
    }
}

#[derive(Clone, Copy)]
pub(super) struct Factors {
    pub options: AdamWOptions,
    pub mu: f64,
    /// The gradients' factor.
    pub clip: f64,
    /// `1 - learning_rate * weight_decay`.
    pub keep: f64,
    /// The learning rate over the first moment's bias, times the node's own part.
    pub rate: f64,
    /// The root of the second moment's bias.
    pub root_bias: f64,
}
