//! The options of `zk0 simulate`.

use crate::simulate::curves::CurveFiles;
use crate::simulate::federation_options::FederationOptions;
use anyhow::{bail, Result};
use serde_json::json;
use std::path::PathBuf;
use zk0_simulate::robots::data::{Dealing, NodeData};
use zk0_simulate::robots::federation::Robots;

/// Simulate a federation on this machine without proofs, to choose rounds, rates and strategies before you spend proofs. The folder `--out` gets
/// `round_N.json` for each round, `loss.svg`, `loss.png` and `loss.json`, and `global.safetensors`.
#[derive(Debug, clap::Args)]
pub struct SimulateOptions {
    #[command(flatten)]
    pub federation: FederationOptions,
    /// Let this share of the nodes take part in a round, chosen anew for each.
    #[arg(long, default_value_t = 1.0, value_name = "SHARE")]
    pub share: f64,
    /// Let each node hold out this share of its episodes, and measure its losses there. Without it, losses are measured on frames that the node
    /// trains on.
    #[arg(long, default_value_t = 0.0, value_name = "SHARE")]
    eval_episodes: f64,
    /// Write the results into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Go on with the simulation in `--out`. More rounds than before are possible; everything else has to be as it was.
    #[arg(long)]
    pub resume: bool,
    /// Write the curves into this folder, too, as TensorBoard event files: global/, and a folder for each node and each unseen recording. Steps
    /// are optimiser steps of a node.
    #[arg(long, value_name = "FOLDER")]
    tensorboard: Option<PathBuf>,
}

impl SimulateOptions {
    /// Refuses invalid options.
    pub fn check(&self) -> Result<()> {
        if !(self.share > 0.0 && self.share <= 1.0) {
            bail!(
                "--share is {}; it has to be above 0 and at most 1",
                self.share
            );
        }
        Ok(())
    }

    /// The nodes' data.
    pub fn dealing(&self) -> Dealing {
        self.federation.dealing(self.eval_episodes)
    }

    /// The curves' files, if wanted.
    pub fn curves(&self, robots: &Robots, unseen: &[NodeData]) -> Result<Option<CurveFiles>> {
        let Some(folder) = &self.tensorboard else {
            return Ok(None);
        };
        let (nodes, unseen) = (robots.nodes.iter().map(name), unseen.iter().map(name));
        CurveFiles::open(
            folder,
            self.resume,
            self.federation.steps as u64,
            nodes,
            unseen,
        )
        .map(Some)
    }

    /// What decides the results, besides recordings and weights.
    pub fn identity(&self) -> String {
        let identity = json!([
            self.federation.strategy,
            self.federation.training(),
            self.dealing(),
            self.share,
        ]);
        identity.to_string()
    }
}

fn name(data: &NodeData) -> &str {
    &data.name
}
