//! How to train.

use serde::{Deserialize, Serialize};

use crate::error::{PolicyError, Result};
use crate::train::optimizer::AdamWOptions;
use crate::train::schedule::Schedule;

/// What is trained.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TrainScope {
    /// The expert, and the action and time projections, which nodes exchange. The rest is computed once per frame.
    #[default]
    Expert,
    /// Also the state projection, as LeRobot by default. Its token runs through the frozen language layers at every step, both ways.
    ExpertAndState,
}

/// How to train, by default LeRobot's preset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainOptions {
    /// Optimiser steps.
    pub steps: usize,
    /// Samples a step.
    pub batch_size: usize,
    /// Peak learning rate. LeRobot fine-tunes at 1e-4; small profiles from scratch need at least 1e-3.
    pub learning_rate: f64,
    /// The learning rate's course.
    pub schedule: Schedule,
    /// Optimiser settings.
    pub adamw: AdamWOptions,
    /// Weight of FedProx's proximal term; 0 for none.
    pub fedprox_mu: f64,
    /// Decides the samples' order, times and noise.
    pub seed: u64,
}

impl Default for TrainOptions {
    fn default() -> Self {
        Self {
            steps: 30_000,
            batch_size: 8,
            learning_rate: 1e-4,
            schedule: Schedule::LEROBOT,
            adamw: AdamWOptions::default(),
            fedprox_mu: 0.0,
            seed: 0,
        }
    }
}

impl TrainOptions {
    /// Refuses useless options.
    ///
    /// # Errors
    /// [`PolicyError::Options`] names the option.
    pub fn check(&self) -> Result<()> {
        let wrong = |what: String| Err(PolicyError::Options(what));
        if self.steps == 0 {
            return wrong("`steps` is 0".into());
        }
        if !(1..=1 << 16).contains(&self.batch_size) {
            return wrong(format!(
                "`batch_size` is {}; it must be in 1..=65536",
                self.batch_size
            ));
        }
        if !(self.learning_rate > 0.0 && self.learning_rate.is_finite()) {
            return wrong(format!(
                "`learning_rate` is {}; it must be above 0",
                self.learning_rate
            ));
        }
        if !(self.fedprox_mu >= 0.0 && self.fedprox_mu.is_finite()) {
            return wrong(format!(
                "`fedprox_mu` is {}; it must be 0 or above",
                self.fedprox_mu
            ));
        }
        let a = &self.adamw;
        for (name, value) in [("beta1", a.beta1), ("beta2", a.beta2)] {
            if !(0.0..1.0).contains(&value) {
                return wrong(format!("`{name}` is {value}; it must be in [0, 1)"));
            }
        }
        for (name, value) in [("eps", a.eps), ("clip_norm", a.clip_norm)] {
            if !(value > 0.0 && value.is_finite()) {
                return wrong(format!("`{name}` is {value}; it must be above 0"));
            }
        }
        if !(a.weight_decay >= 0.0 && a.weight_decay.is_finite()) {
            return wrong(format!(
                "`weight_decay` is {}; it must be 0 or above",
                a.weight_decay
            ));
        }
        self.schedule.check()
    }
}
