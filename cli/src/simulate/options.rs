//! The options of `zk0 simulate`.

use crate::dataset::RecordingName;
use crate::policy::{self, CacheOptions, PolicySource};
use anyhow::{bail, Context, Result};
use serde_json::json;
use std::path::PathBuf;
use std::thread;
use zk0_protocol::rules::network_rules::Strategy;
use zk0_simulate::robots::data::Dealing;
use zk0_simulate::robots::federation::Training;
use zk0_smolvla::Profile;

/// Simulate a federation on this machine without proofs, to choose rounds, rates and strategies before you spend proofs. The folder `--out` gets
/// `round_N.json` for each round, `loss.svg`, `loss.png` and `loss.json`, and `global.safetensors`.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// A recording for a node: a LeRobotDataset folder, or hub:owner/name[@revision]. Repeat the option to give each node one.
    #[arg(long = "dataset", value_name = "RECORDING", required = true)]
    pub datasets: Vec<RecordingName>,
    /// Simulate this many nodes. The episodes of all recordings are dealt out to them: number I goes to node I modulo N. Without this option,
    /// there is a node for each recording.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    nodes: Option<u64>,
    /// Measure losses on this recording, too. No node has it. Repeat the option for more recordings.
    #[arg(long, value_name = "RECORDING")]
    pub unseen: Vec<RecordingName>,
    /// Start from this policy: a policy file, or a LeRobot policy folder.
    #[arg(long, value_name = "PATH")]
    policy: Option<PathBuf>,
    /// Start from random weights of this size instead: micro, tiny or full (the published dimensions) [default: micro]
    #[arg(long, value_name = "NAME", value_parser = Profile::from_name, conflicts_with = "policy")]
    profile: Option<Profile>,
    /// Simulate this many rounds.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub rounds: u64,
    /// Let this share of the nodes take part in a round, chosen anew for each.
    #[arg(long, default_value_t = 1.0, value_name = "SHARE")]
    pub share: f64,
    /// How updates are combined, as in a network's rules: fed-avg, median, or a JSON value such as '{"trimmed-mean": {"trim_bps": 1000}}'.
    #[arg(long, default_value = "fed-avg", value_name = "STRATEGY")]
    strategy: String,
    /// Each node makes this many optimiser steps in a round.
    #[arg(long, default_value_t = 600)]
    steps: usize,
    /// Use this many samples in each step.
    #[arg(long, default_value_t = 32)]
    batch_size: usize,
    /// Train at this learning rate.
    #[arg(long, default_value_t = 0.002)]
    learning_rate: f64,
    /// Pull the weights towards the round's base weights with this strength (FedProx).
    #[arg(long, default_value_t = 0.0, value_name = "MU")]
    fedprox_mu: f64,
    /// Take this part of each step from the node's own gradients, above 0 and at most 1, and the rest from the last global step (FedCM).
    #[arg(long, default_value_t = 1.0, value_name = "ALPHA")]
    fedcm_alpha: f64,
    /// Let each node hold out this share of its episodes, and measure its losses there. Without it, losses are measured on frames that the node
    /// trains on.
    #[arg(long, default_value_t = 0.0, value_name = "SHARE")]
    eval_episodes: f64,
    /// Measure a node's losses on at most this many frames.
    #[arg(long, default_value_t = 64, value_name = "COUNT")]
    eval_frames: usize,
    /// Decides everything that is random: weights, held-out episodes, which nodes take part, the order of samples, noise and times. With 0, nodes
    /// train as in a network.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u64).range(..1 << 31))]
    pub seed: u64,
    /// Train this many nodes at a time [default: as many as there are cores; 1 for policies above a million expert weights]
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..=1024))]
    threads: Option<u64>,
    /// Write the results into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Go on with the simulation in `--out`. More rounds than before are possible; everything else has to be as it was.
    #[arg(long)]
    pub resume: bool,
    #[command(flatten)]
    pub cache: CacheOptions,
}

impl Options {
    /// The policy to start from.
    pub fn source(&self) -> Result<PolicySource> {
        let profile = match self.policy {
            None => self.profile.or(Some(Profile::Micro)),
            Some(_) => None,
        };
        policy::one(self.policy.as_ref(), profile, self.seed)
    }

    /// How updates are combined.
    pub fn strategy(&self) -> Result<Strategy> {
        let given = self.strategy.trim();
        let value = match given.starts_with(['{', '"']) {
            true => serde_json::from_str(given),
            false => serde_json::from_value(given.into()),
        };
        value.with_context(|| {
            format!("--strategy {given}: a strategy is fed-avg, median, or a JSON value as in a network's rules (docs/governance.md)")
        })
    }

    /// How nodes train.
    pub fn training(&self) -> Result<Training> {
        if !(self.share > 0.0 && self.share <= 1.0) {
            bail!(
                "--share is {}; it has to be above 0 and at most 1",
                self.share
            );
        }
        Ok(Training {
            steps: self.steps,
            batch_size: self.batch_size,
            learning_rate: self.learning_rate,
            fedprox_mu: self.fedprox_mu,
            fedcm_alpha: self.fedcm_alpha,
            seed: self.seed,
        })
    }

    /// Which data nodes get.
    pub fn dealing(&self) -> Dealing {
        Dealing {
            nodes: self.nodes.map(|nodes| nodes as usize),
            held_out: self.eval_episodes,
            evaluated: self.eval_frames,
            seed: self.seed,
        }
    }

    /// What decides the results besides the recordings and the policy's weights.
    pub fn identity(&self) -> Result<String> {
        let identity = json!([
            self.strategy()?,
            self.training()?,
            self.dealing(),
            self.share,
        ]);
        Ok(identity.to_string())
    }

    /// How many nodes train at a time, where the policy has so many expert weights.
    pub fn threads(&self, weights: usize) -> usize {
        let cores = || thread::available_parallelism().map_or(1, usize::from);
        match self.threads {
            Some(threads) => threads as usize,
            // A large policy keeps all cores busy by itself.
            None if weights > 1_000_000 => 1,
            None => cores(),
        }
    }
}
