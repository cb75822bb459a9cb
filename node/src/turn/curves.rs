//! The TensorBoard curves of a node's training and claims, over the optimiser steps of all rounds.

use crate::tensorboard::{metrics, EventFile};
use crate::training_history::TrainingHistory;
use std::path::Path;
use std::time::Instant;
use zk0_smolvla::train::TrainingStep;

pub(super) struct Curves<'a> {
    file: Option<&'a EventFile>,
    round: u64,
    /// Steps made before this round.
    before: u64,
    /// When the last step ended.
    clock: Instant,
}

impl<'a> Curves<'a> {
    /// For a round whose training begins.
    pub fn of(file: Option<&'a EventFile>, state: &Path, round: u64) -> Self {
        Self::from(file, state, round, round)
    }

    /// For a round in which the node has trained.
    pub fn after(file: Option<&'a EventFile>, state: &Path, round: u64) -> Self {
        Self::from(file, state, round, round.saturating_add(1))
    }

    /// Counts the steps before the round `end`.
    fn from(file: Option<&'a EventFile>, state: &Path, round: u64, end: u64) -> Self {
        Self {
            file,
            round,
            before: file.map_or(0, |_| TrainingHistory::steps_before(state, end)),
            clock: Instant::now(),
        }
    }

    pub fn stepped(&mut self, step: &TrainingStep) {
        let Some(file) = self.file else {
            return;
        };
        let seconds = self.clock.elapsed().as_secs_f64();
        self.clock = Instant::now();
        let mut values = vec![
            (metrics::LOSS, f64::from(step.loss)),
            (metrics::GRAD_NORM, step.gradient_norm),
            (metrics::LEARNING_RATE, step.learning_rate),
            (metrics::STEP_SECONDS, seconds),
            (metrics::ROUND, self.round as f64),
        ];
        if step.proximal > 0.0 {
            values.push((metrics::FEDPROX, step.proximal));
        }
        file.scalars(self.before + step.step as u64, &values);
    }

    /// The node has proven that the loss fell from `before` to `after`.
    pub fn proven(&self, before: f64, after: f64) {
        if let Some(file) = self.file {
            let values = [
                (metrics::EVAL_BASE_LOSS, before),
                (metrics::EVAL_LOSS, after),
            ];
            file.scalars(self.before, &values);
        }
    }
}
