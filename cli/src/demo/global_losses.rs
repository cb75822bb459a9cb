//! Losses of a network's global weights on its nodes' recordings, and on one that no node has.

use anyhow::Result;
use serde::Serialize;
use std::path::PathBuf;
use zk0_audit::report::public_losses::PublicLosses;
use zk0_circuits::{Digest, EvalSpec};
use zk0_ledger::blobs::Blobs;
use zk0_lerobot::dataset::Dataset;
use zk0_node::exchanged_weights::Base;
use zk0_node::recording;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::genesis::Genesis;
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::measure::evaluate;
use zk0_smolvla::policy::policy_file;
use zk0_smolvla::{ExpertWeights, PolicyConfig};
use zk0_weights::Format;

const MAX_WEIGHTS: u64 = 1 << 30;

/// A recording to evaluate on.
pub struct EvaluationRecording {
    /// The recording.
    pub path: PathBuf,
    /// Its node, if any.
    pub node: Option<String>,
    /// Whether the node trains on it, as honest nodes do.
    pub trains: bool,
}

/// A round's result.
#[derive(Serialize)]
pub struct RoundResult {
    /// The round.
    pub round: u64,
    /// SHA-256 of the new weights.
    pub weights: String,
    /// Number of averaged updates.
    pub contributors: usize,
    /// Losses on each recording.
    pub losses: Vec<GlobalLoss>,
    /// The ledger's losses on the public samples, in fixed point.
    pub recorded: Option<PublicLosses>,
}

/// Mean float32 losses before and after a round. Noise and times are the same in all rounds.
#[derive(Serialize)]
pub struct GlobalLoss {
    /// Name of the recording's folder.
    pub recording: String,
    /// Its node, if any.
    pub node: Option<String>,
    /// Whether the node trains on it.
    pub trains: bool,
    /// Under the base.
    pub before: f64,
    /// Under the result.
    pub after: f64,
}

impl GlobalLoss {
    /// Whose it is, in a word or two.
    pub fn whose(&self) -> String {
        match &self.node {
            Some(node) if self.trains => node.clone(),
            Some(node) => format!("{node} (lazy)"),
            None => "unseen".into(),
        }
    }
}

/// A ledger's global weights, as LeRobot reads them.
pub struct GlobalWeights<'a> {
    blobs: &'a Blobs,
    format: Format,
    config: PolicyConfig,
}

impl<'a> GlobalWeights<'a> {
    /// Those of the network that `genesis` founded.
    pub fn of(genesis: &Genesis, blobs: &'a Blobs) -> Result<Self> {
        blobs.check(&genesis.policy)?;
        Ok(Self {
            blobs,
            format: Format::new(&EvalSpec::decode(&genesis.evaluation)?)?,
            config: policy_file::load(&blobs.path(&genesis.policy))?
                .policy
                .config,
        })
    }

    /// Reads the weights with this digest.
    pub fn read(&self, weights: &Digest) -> Result<ExpertWeights> {
        let file = self.blobs.get(weights, MAX_WEIGHTS)?;
        Ok(Base::read(&self.format, &self.config, &file)?.weights)
    }
}

/// The results of all closed rounds.
pub fn global(
    entries: &[Entry],
    genesis: &Genesis,
    weights: &GlobalWeights<'_>,
    recordings: &[EvaluationRecording],
) -> Result<Vec<RoundResult>> {
    let recordings = recordings
        .iter()
        .map(|one| PreparedRecording::new(one, genesis, weights.blobs))
        .collect::<Result<Vec<_>>>()?;
    let losses = |digest: &Digest| {
        let weights = weights.read(digest)?;
        let each = recordings.iter().map(|one| one.loss(&weights));
        each.collect::<Result<Vec<f64>>>()
    };
    let bits = EvalSpec::decode(&genesis.evaluation)?.action;
    let mut before = losses(&genesis.initial.blob)?;
    let mut global = Vec::new();
    for entry in entries {
        let Body::RoundClosed(closed) = &entry.body else {
            continue;
        };
        let after = losses(&closed.global.blob)?;
        let pairs = recordings.iter().zip(before.iter().zip(&after));
        let losses = pairs.map(|(one, (before, after))| GlobalLoss {
            recording: one.name.clone(),
            node: one.node.clone(),
            trains: one.trains,
            before: *before,
            after: *after,
        });
        global.push(RoundResult {
            round: closed.round,
            weights: closed.global.blob.to_string(),
            contributors: closed.contributors.len(),
            losses: losses.collect(),
            recorded: closed
                .evaluated
                .as_ref()
                .map(|evaluated| PublicLosses::of(evaluated, bits)),
        });
        before = after;
    }
    Ok(global)
}

struct PreparedRecording {
    name: String,
    node: Option<String>,
    trains: bool,
    config: PolicyConfig,
    samples: Vec<PreparedSample>,
    draws: Vec<evaluate::FlowDraw>,
}

impl PreparedRecording {
    fn new(recording: &EvaluationRecording, genesis: &Genesis, blobs: &Blobs) -> Result<Self> {
        let path = &recording.path;
        blobs.check(&genesis.policy)?;
        let file = policy_file::load(&blobs.path(&genesis.policy))?;
        let samples = recording::prepare_samples(&Dataset::open(path)?, &file, None)?;
        let config = file.policy.config;
        let draws = evaluate::fixed_draws(&config, samples.len(), 0);
        let name = path.file_name().unwrap_or(path.as_os_str());
        Ok(Self {
            name: name.to_string_lossy().into_owned(),
            node: recording.node.clone(),
            trains: recording.trains,
            config,
            samples,
            draws,
        })
    }

    fn loss(&self, weights: &ExpertWeights) -> Result<f64> {
        let pairs: Vec<_> = self.samples.iter().zip(&self.draws).collect();
        Ok(evaluate::evaluate(&self.config, weights, &pairs)?.loss())
    }
}
