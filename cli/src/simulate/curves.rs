//! A simulation's curves for TensorBoard: a run for the global weights, each node and each unseen recording. Steps are a node's optimiser
//! steps.

use anyhow::{bail, Context, Result};
use std::collections::BTreeMap;
use std::path::Path;
use zk0_node::tensorboard::{metrics, EventFile};
use zk0_simulate::robots::outcome::{SimulatedRound, TrainedNode};

/// Each node has an open file.
const MAX_NODES: usize = 500;

/// The curves' files.
pub struct CurveFiles {
    steps: u64,
    global: EventFile,
    nodes: Vec<EventFile>,
    unseen: Vec<EventFile>,
}

impl CurveFiles {
    /// Opens `folder`. A resumed simulation continues its curves.
    ///
    /// # Errors
    /// There are too many nodes, or the folder holds another run's curves or cannot be written to.
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

    /// Adds a round's results.
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
