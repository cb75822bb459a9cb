//! The federation of `zk0 simulate` and `zk0 compare`: data, policy, and training.

use crate::dataset::{of_recording, CameraNames, RecordingName};
use crate::policy::{self, CacheOptions, PolicySource};
use anyhow::Result;
use std::path::PathBuf;
use std::thread;
use zk0_lerobot::dataset::refuse_different;
use zk0_protocol::rules::network_rules::Strategy;
use zk0_simulate::robots::data::{Dealing, SampledRecording};
use zk0_simulate::robots::federation::Training;
use zk0_smolvla::policy::policy_file::PolicyFile;
use zk0_smolvla::{ExpertWeights, Profile};

/// The federation on this machine.
#[derive(Debug, clap::Args)]
pub struct FederationOptions {
    /// A recording for a node: a LeRobotDataset folder, or hub:owner/name[@revision]. Repeat the option to give each node one.
    #[arg(long = "dataset", value_name = "RECORDING", required = true)]
    pub datasets: Vec<RecordingName>,
    #[command(flatten)]
    cameras: CameraNames,
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
    /// How updates are combined, as in a network's rules: fed-avg, median, or a JSON value such as '{"trimmed-mean": {"trim_bps": 1000}}'.
    #[arg(long, default_value = "fed-avg", value_name = "STRATEGY", value_parser = strategy)]
    pub strategy: Strategy,
    /// Each node makes this many optimiser steps in a round.
    #[arg(long, default_value_t = 600)]
    pub steps: usize,
    /// Use this many samples in each step.
    #[arg(long, default_value_t = 32)]
    batch_size: usize,
    /// Train at this learning rate.
    #[arg(long, default_value_t = 0.002)]
    pub learning_rate: f64,
    /// Pull the weights towards the round's base weights with this strength (FedProx).
    #[arg(long, default_value_t = 0.0, value_name = "MU")]
    pub fedprox_mu: f64,
    /// Take this part of each step from the node's own gradients, above 0 and at most 1, and the rest from the last global step (FedCM).
    #[arg(long, default_value_t = 1.0, value_name = "ALPHA")]
    fedcm_alpha: f64,
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
    #[command(flatten)]
    cache: CacheOptions,
}

/// The initial policy, and the recordings as samples.
pub struct StartingPoint {
    /// The policy.
    pub file: PolicyFile,
    /// What nodes have.
    pub recordings: Vec<SampledRecording>,
    /// What no node has.
    pub unseen: Vec<SampledRecording>,
}

/// Reads a strategy from an option.
pub fn strategy(given: &str) -> Result<Strategy, String> {
    let given = given.trim();
    let value = if given.starts_with(['{', '"']) {
        serde_json::from_str(given)
    } else {
        serde_json::from_value(given.into())
    };
    value.map_err(|error| {
        format!("a strategy is fed-avg, median, or a JSON value as in a network's rules (docs/governance.md): {error}")
    })
}

impl FederationOptions {
    /// The initial policy, by default with random weights of this seed.
    pub fn source(&self, seed: u64) -> Result<PolicySource> {
        let profile = match self.policy {
            None => self.profile.or(Some(Profile::Micro)),
            Some(_) => None,
        };
        policy::one(self.policy.as_ref(), profile, seed)
    }

    /// Whether the policy has random weights.
    pub fn starts_at_random(&self) -> bool {
        self.policy.is_none()
    }

    /// Reads the policy and all recordings.
    pub fn open(&self) -> Result<StartingPoint> {
        let file = self.source(self.seed)?.load()?;
        let cache = self.cache.open()?;
        let names = || self.datasets.iter().chain(&self.unseen);
        let datasets = RecordingName::open_together(names(), &self.cameras.rename_map)?;
        refuse_different(datasets.iter().map(|d| (d.root(), d.info())))?;
        let recorded = datasets.iter().zip(names()).map(|(dataset, name)| {
            let recorded = SampledRecording::of(dataset, &file, cache.as_ref());
            recorded.map_err(|error| of_recording(error.into(), name))
        });
        let mut recordings = recorded.collect::<Result<Vec<_>>>()?;
        let unseen = recordings.split_off(self.datasets.len());
        Ok(StartingPoint {
            file,
            recordings,
            unseen,
        })
    }

    /// How nodes train.
    pub fn training(&self) -> Training {
        Training {
            steps: self.steps,
            batch_size: self.batch_size,
            learning_rate: self.learning_rate,
            fedprox_mu: self.fedprox_mu,
            fedcm_alpha: self.fedcm_alpha,
            seed: self.seed,
        }
    }

    /// The nodes' data. Each holds out this share of its episodes.
    pub fn dealing(&self, held_out: f64) -> Dealing {
        Dealing {
            nodes: self.nodes.map(|nodes| nodes as usize),
            held_out,
            set_aside: 0.0,
            evaluated: self.eval_frames,
            seed: self.seed,
        }
    }

    /// How many nodes train at a time.
    pub fn threads(&self, expert: &ExpertWeights) -> usize {
        let tensors = expert.tensors().values();
        let weights: usize = tensors.map(|tensor| tensor.data.len()).sum();
        let cores = || thread::available_parallelism().map_or(1, usize::from);
        match self.threads {
            Some(threads) => threads as usize,
            // A large policy keeps all cores busy.
            None if weights > 1_000_000 => 1,
            None => cores(),
        }
    }
}
