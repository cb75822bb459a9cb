//! The curves of a simulation, for TensorBoard: a folder for the global weights, for each node and for each unseen recording, so that TensorBoard
//! draws them as runs. Their steps are the optimiser steps that a node makes in the rounds so far.

use anyhow::{bail, Context, Result};
use std::collections::BTreeMap;
use std::path::Path;
use zk0_simulate::robots::outcome::{SimulatedRound, TrainedNode};
use zk0_tensorboard::{metrics, EventFile};

/// Each node has an open file, and more would be no use in TensorBoard.
const MAX_NODES: usize = 500;

/// The files.
pub struct CurveFiles {
    /// Optimiser steps of a round.
    steps: u64,
    global: EventFile,
    nodes: Vec<EventFile>,
    unseen: Vec<EventFile>,
}

impl CurveFiles {
    /// In `folder`, of a simulation with these nodes and unseen recordings. One that goes on goes on with its curves.
    ///
    /// # Errors
    /// There are too many nodes, the folder holds the curves of another run, or it cannot be written to.
    pub fn open<'n>(
        folder: &Path,
        goes_on: bool,
        steps: u64,
        nodes: impl ExactSizeIterator<Item = &'n str>,
        unseen: impl Iterator<Item = &'n str>,
    ) -> Result<Self> {
        if nodes.len() > MAX_NODES {
            bail!(
                "--tensorboard makes a folder for each node, for at most {MAX_NODES}, and there are {}: leave it out, or simulate fewer nodes",
                nodes.len()
            );
        }
        let open = |name: &str| {
            let folder = folder.join(name);
            let file = if goes_on {
                EventFile::go_on(&folder)
            } else {
                EventFile::begin(&folder)
            };
            file.context("--tensorboard")
        };
        let unseen = unseen.enumerate();
        let unseen = unseen.map(|(number, name)| open(&format!("unseen-{}-{name}", number + 1)));
        Ok(Self {
            steps,
            global: open("global")?,
            nodes: nodes.map(open).collect::<Result<_>>()?,
            unseen: unseen.collect::<Result<_>>()?,
        })
    }

    /// Adds what a round came to.
    pub fn add(&self, round: &SimulatedRound) {
        let step = round.round.saturating_mul(self.steps);
        let number = (metrics::ROUND, round.round as f64);
        let mut values = vec![(metrics::EVAL_LOSS, round.mean_loss), number];
        if let Some(told) = &round.aggregated_client_metrics {
            values.push((metrics::LOSS, told.avg_client_loss));
            values.push((metrics::GRAD_NORM, told.avg_client_grad_norm));
        }
        self.global.scalars(step, &values);
        let told = round.individual_client_metrics.iter();
        let told: BTreeMap<_, _> = told.map(|one| (one.client_id.as_str(), one)).collect();
        for (file, evaluated) in self.nodes.iter().zip(&round.nodes) {
            let mut values = vec![(metrics::EVAL_LOSS, evaluated.loss), number];
            if let Some(told) = told.get(evaluated.name.as_str()) {
                values.extend(trained(told));
            }
            file.scalars(step, &values);
        }
        for (file, evaluated) in self.unseen.iter().zip(&round.unseen) {
            file.scalars(step, &[(metrics::EVAL_LOSS, evaluated.loss), number]);
        }
    }
}

/// The means over a node's steps in a round.
fn trained(told: &TrainedNode) -> Vec<(&'static str, f64)> {
    let mut values = vec![
        (metrics::LOSS, told.loss),
        (metrics::GRAD_NORM, told.grad_norm),
        (metrics::LEARNING_RATE, told.learning_rate),
    ];
    if told.fedprox_loss > 0.0 {
        values.push((metrics::FEDPROX, told.fedprox_loss));
    }
    values
}
