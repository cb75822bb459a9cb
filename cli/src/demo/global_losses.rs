//! The losses of a network's global weights, on the recordings of its nodes and on one that nobody trained on.

use anyhow::Result;
use serde::Serialize;
use std::path::PathBuf;
use zk0_circuits::Digest;
use zk0_ledger::blobs::Blobs;
use zk0_lerobot::dataset::Dataset;
use zk0_node::recording;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::genesis::Genesis;
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::measure::evaluate;
use zk0_smolvla::policy::policy_file;
use zk0_smolvla::{ExpertWeights, PolicyConfig};

/// Largest file of weights that the demo reads.
pub const MAX_WEIGHTS: u64 = 1 << 30;

/// A recording to evaluate on.
pub struct Evaluated {
    /// The recording.
    pub path: PathBuf,
    /// The honest node that trains on it; `None` if nobody does.
    pub trained_by: Option<String>,
}

/// A round's result.
#[derive(Serialize)]
pub struct Global {
    /// The round.
    pub round: u64,
    /// SHA-256 of the new weights.
    pub weights: String,
    /// How many updates were averaged.
    pub contributors: usize,
    /// The losses on each recording.
    pub losses: Vec<GlobalLoss>,
}

/// Mean float32 losses of the round's base and of its result, with the same noise and times in all rounds.
#[derive(Serialize)]
pub struct GlobalLoss {
    /// The name of the recording's folder.
    pub recording: String,
    /// The honest node that trains on it; `None` if nobody does.
    pub trained_by: Option<String>,
    /// Under the base.
    pub before: f64,
    /// Under the result.
    pub after: f64,
}

impl GlobalLoss {
    /// Whose recording it is, in a word or two.
    pub fn whose(&self) -> &str {
        self.trained_by.as_deref().unwrap_or("unseen")
    }
}

/// The results of all closed rounds.
pub fn global(
    entries: &[Entry],
    genesis: &Genesis,
    blobs: &Blobs,
    recordings: &[Evaluated],
) -> Result<Vec<Global>> {
    let recordings = recordings
        .iter()
        .map(|one| Prepared::new(one, genesis, blobs))
        .collect::<Result<Vec<_>>>()?;
    let losses = |weights: &Digest| {
        let each = recordings.iter().map(|one| one.loss(blobs, weights));
        each.collect::<Result<Vec<f64>>>()
    };
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
            trained_by: one.trained_by.clone(),
            before: *before,
            after: *after,
        });
        global.push(Global {
            round: closed.round,
            weights: closed.global.blob.to_string(),
            contributors: closed.contributors.len(),
            losses: losses.collect(),
        });
        before = after;
    }
    Ok(global)
}

/// A recording, with fixed noise and times.
struct Prepared {
    name: String,
    trained_by: Option<String>,
    config: PolicyConfig,
    samples: Vec<PreparedSample>,
    draws: Vec<evaluate::FlowDraw>,
}

impl Prepared {
    fn new(recording: &Evaluated, genesis: &Genesis, blobs: &Blobs) -> Result<Self> {
        let path = &recording.path;
        blobs.check(&genesis.policy)?;
        let file = policy_file::load(&blobs.path(&genesis.policy))?;
        let samples = recording::prepare_samples(&Dataset::open(path)?, &file, None)?;
        let config = file.policy.config;
        let draws = evaluate::fixed_draws(&config, samples.len(), 0);
        let name = path.file_name().unwrap_or(path.as_os_str());
        Ok(Self {
            name: name.to_string_lossy().into_owned(),
            trained_by: recording.trained_by.clone(),
            config,
            samples,
            draws,
        })
    }

    fn loss(&self, blobs: &Blobs, weights: &Digest) -> Result<f64> {
        let config = &self.config;
        let weights = ExpertWeights::from_safetensors(config, &blobs.get(weights, MAX_WEIGHTS)?)?;
        let pairs: Vec<_> = self.samples.iter().zip(&self.draws).collect();
        Ok(evaluate::evaluate(config, &weights, &pairs)?.loss())
    }
}
