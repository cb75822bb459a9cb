//! One run: a variant trains with a seed and is measured along the way, as int16 weights. All variants have the same first weights,
//! samples, evaluated frames, noise and times.

use crate::compare::variant::{Hyperparameters, SameSteps, Variant, VariantKind};
use crate::robots::data::NodeData;
use crate::robots::error::SimulationError;
use crate::robots::federation::{Robots, Training};
use crate::rounds;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::sync::Arc;
use zk0_node::error::ParticipantError;
use zk0_protocol::rules::network_rules::Strategy;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::train::{TrainOptions, Trainer, TrainingSamples};
use zk0_smolvla::{ExpertWeights, PolicyConfig, PolicyError};
use zk0_weights::Format;

/// What all runs share.
pub struct ComparisonSetting {
    /// The policy's dimensions.
    pub config: PolicyConfig,
    /// The format of its weights.
    pub format: Format,
    /// The nodes.
    pub nodes: Arc<[NodeData]>,
    /// Recordings that no variant trains on.
    pub unseen: Vec<NodeData>,
    /// The federation's rounds.
    pub rounds: u64,
    /// How a node trains, but for learning rate, μ and seed.
    pub training: Training,
    /// Centralised training's steps.
    pub same_steps: SameSteps,
    /// The rounds to measure after, in ascending order, from 0 to the final one.
    pub measured: Vec<u64>,
}

/// Losses after some rounds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// The rounds, or the steps that stand for them.
    pub round: u64,
    /// Losses on each node's held-out frames, then on each unseen recording.
    pub losses: Vec<f64>,
}

/// A run's result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Who trained on what.
    pub variant: Variant,
    /// The seed.
    pub seed: u64,
    /// How it trained.
    pub values: Hyperparameters,
    /// The steps of all who trained.
    pub steps: u64,
    /// The losses along the way.
    pub points: Vec<CurvePoint>,
}

/// The first and last round, and some between, evenly spread.
pub fn measured_rounds(rounds: u64, most: u64) -> Vec<u64> {
    let between = rounds.min(most);
    (0..=between).map(|one| one * rounds / between).collect()
}

struct Union<'a>(Vec<&'a [PreparedSample]>);

impl SampleSource<PreparedSample> for Union<'_> {
    fn len(&self) -> usize {
        self.0.iter().map(|part| part.len()).sum()
    }

    fn sample(&self, index: usize) -> Result<Cow<'_, PreparedSample>, PolicyError> {
        let mut place = index;
        for part in &self.0 {
            match part.get(place) {
                Some(sample) => return Ok(Cow::Borrowed(sample)),
                None => place -= part.len(),
            }
        }
        let len = self.len();
        let what = format!("there is no sample {index} among {len}");
        Err(PolicyError::Sample(what))
    }
}

impl ComparisonSetting {
    /// Trains `variant` from `start` on `threads` threads.
    ///
    /// # Errors
    /// Training fails or diverges, or no network accepts a value.
    pub fn run(
        &self,
        variant: Variant,
        values: &Hyperparameters,
        seed: u64,
        start: &ExpertWeights,
        threads: usize,
    ) -> Result<Run, SimulationError> {
        let robots = Robots::new(
            self.config.clone(),
            self.format.clone(),
            values.strategy.unwrap_or(Strategy::FedAvg),
            Training {
                learning_rate: values.learning_rate,
                fedprox_mu: values.fedprox_mu.unwrap_or(0.0),
                seed,
                ..self.training
            },
            self.nodes.clone(),
        )?;
        let points = match variant {
            Variant::Federated => self.in_rounds(&robots, start, threads)?,
            Variant::Centralised | Variant::Alone(_) => {
                self.in_one_go(&robots, variant, values, seed, start)?
            }
        };
        Ok(Run {
            variant,
            seed,
            values: values.clone(),
            steps: self.rounds * self.steps_in_a_round(variant) as u64,
            points,
        })
    }

    /// The mean final loss on held-out frames: of each node alone on its own, of the others on all nodes'.
    ///
    /// # Errors
    /// Those of [`Self::run`].
    pub fn own_loss(
        &self,
        kind: VariantKind,
        values: &Hyperparameters,
        seed: u64,
        start: &ExpertWeights,
    ) -> Result<f64, SimulationError> {
        let nodes = self.nodes.len();
        let last = |variant| {
            let run = self.run(variant, values, seed, start, 1)?;
            Ok(run
                .points
                .last()
                .map_or(f64::NAN, |point| own(&run.variant, &point.losses, nodes)))
        };
        let variants = Variant::all(nodes).into_iter();
        let variants: Vec<_> = variants.filter(|one| one.kind() == kind).collect();
        let losses: Result<Vec<f64>, SimulationError> =
            variants.iter().copied().map(last).collect();
        Ok(losses?.iter().sum::<f64>() / variants.len() as f64)
    }

    fn steps_in_a_round(&self, variant: Variant) -> usize {
        let steps = self.training.steps;
        self.same_steps.in_a_round(variant, self.nodes.len(), steps)
    }

    fn in_rounds(
        &self,
        robots: &Robots,
        start: &ExpertWeights,
        threads: usize,
    ) -> Result<Vec<CurvePoint>, SimulationError> {
        let all: Vec<usize> = (0..robots.nodes.len()).collect();
        let mut global = robots.start(start)?;
        let mut points = Vec::new();
        for round in 0..=self.rounds {
            if self.measured.contains(&round) {
                points.push(self.measure(robots, round, &global.base.weights)?);
            }
            if round < self.rounds {
                global = rounds::round(robots, round, &all, global, threads)?;
            }
        }
        Ok(points)
    }

    /// One optimiser and one schedule for all steps, as in `zk0 train`.
    fn in_one_go(
        &self,
        robots: &Robots,
        variant: Variant,
        values: &Hyperparameters,
        seed: u64,
        start: &ExpertWeights,
    ) -> Result<Vec<CurvePoint>, SimulationError> {
        let steps = self.steps_in_a_round(variant);
        let who = match variant {
            Variant::Alone(node) => &self.nodes[node..=node],
            _ => &self.nodes[..],
        };
        let samples = Union(who.iter().map(|node| &node.trained_on[..]).collect());
        let options = TrainOptions {
            steps: steps * self.rounds as usize,
            batch_size: self.training.batch_size,
            learning_rate: values.learning_rate,
            // As in a federation's first round.
            seed: seed << 32,
            ..TrainOptions::default()
        };
        // As in a federation.
        let start = robots.start(start)?.base.weights;
        let mut trainer = Trainer::new(
            &self.config,
            &start,
            TrainingSamples::Prepared(&samples),
            options,
        )?;
        let mut points = Vec::new();
        for round in 0..=self.rounds {
            if self.measured.contains(&round) {
                let rounded = robots.start(&trainer.weights()?)?;
                points.push(self.measure(robots, round, &rounded.base.weights)?);
            }
            while trainer.steps_done() < steps * (round as usize + 1) && !trainer.is_done() {
                let stepped = trainer.step().map_err(ParticipantError::from);
                stepped.map_err(|error| SimulationError::Node {
                    round,
                    node: variant.name(&self.nodes),
                    error: Box::new(error),
                })?;
            }
        }
        Ok(points)
    }

    fn measure(
        &self,
        robots: &Robots,
        round: u64,
        weights: &ExpertWeights,
    ) -> Result<CurvePoint, SimulationError> {
        let all = self.nodes.iter().chain(&self.unseen);
        let losses: Result<Vec<_>, _> = all.map(|data| robots.loss(data, weights)).collect();
        Ok(CurvePoint {
            round,
            losses: losses?,
        })
    }
}

/// A run's mean loss on the held-out frames of those who trained.
pub fn own(variant: &Variant, losses: &[f64], nodes: usize) -> f64 {
    match variant {
        Variant::Alone(node) => losses[*node],
        _ => losses[..nodes].iter().sum::<f64>() / nodes as f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_are_measured_at_both_ends() {
        assert_eq!(measured_rounds(3, 10), [0, 1, 2, 3]);
        assert_eq!(measured_rounds(10, 10), (0..=10).collect::<Vec<_>>());
        assert_eq!(
            measured_rounds(25, 10),
            [0, 2, 5, 7, 10, 12, 15, 17, 20, 22, 25]
        );
        assert_eq!(measured_rounds(1, 10), [0, 1]);
        assert_eq!(measured_rounds(7, 1), [0, 7]);
    }

    #[test]
    fn the_union_has_all_frames_in_the_order_of_the_nodes() {
        let frames = |from: usize, to: usize| -> Vec<PreparedSample> {
            (from..to)
                .map(|number| PreparedSample {
                    prefix_tokens: number,
                    keys: Vec::new(),
                    values: Vec::new(),
                    actions: Vec::new(),
                    is_pad: Vec::new(),
                })
                .collect()
        };
        let (one, other) = (frames(0, 3), frames(3, 8));
        let union = Union(vec![&one, &[], &other]);
        assert_eq!(union.len(), 8);
        for number in 0..8 {
            assert_eq!(union.sample(number).unwrap().prefix_tokens, number);
        }
        let error = union.sample(8).unwrap_err().to_string();
        assert!(error.contains("there is no sample 8 among 8"), "{error}");
    }
}
