//! The policy and the recordings of a comparison.

use crate::compare::options::CompareOptions;
use crate::simulate::federation_options::StartingPoint;
use anyhow::{bail, Result};
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use zk0_circuits::{Digest, EvalSpec};
use zk0_simulate::compare::run::ComparisonSetting;
use zk0_simulate::robots::data::{deal, unseen, Dealing, SampledRecording};
use zk0_simulate::robots::error::SimulationError;
use zk0_smolvla::measure::fixed_point::dims;
use zk0_smolvla::ExpertWeights;
use zk0_weights::Format;

/// What all runs share.
pub struct PreparedRuns {
    opened: StartingPoint,
    format: Format,
    /// The digest of policy, recordings and options.
    pub of: Digest,
    /// Runs at a time.
    pub threads: usize,
}

impl PreparedRuns {
    /// Reads the policy and the recordings.
    pub fn open(options: &CompareOptions) -> Result<Self> {
        let opened = options.federation.open()?;
        let all = || opened.recordings.iter().chain(&opened.unseen);
        no_episode_twice(all())?;
        let spec = EvalSpec::new(dims(&opened.file.policy.config)?);
        let format = Format::new(&spec).map_err(SimulationError::from)?;
        let expert = &opened.file.policy.expert;
        let mut of = Sha256::new();
        of.update(expert.to_safetensors()?);
        of.update(options.identity());
        for recorded in all() {
            of.update(recorded.digest);
        }
        Ok(Self {
            format,
            of: Digest(of.finalize().into()),
            threads: options.federation.threads(expert),
            opened,
        })
    }

    /// What the runs with these data share.
    pub fn setting(
        &self,
        options: &CompareOptions,
        dealing: &Dealing,
        measured: Vec<u64>,
    ) -> Result<ComparisonSetting> {
        let StartingPoint {
            file,
            recordings,
            unseen: others,
        } = &self.opened;
        let nodes = deal(recordings, file, dealing)?;
        if nodes.len() < 2 {
            bail!("a federation of one node has nobody to be compared with: name more recordings with --dataset, or add --nodes 2");
        }
        let unseen = others.iter().map(|one| unseen(one, file, dealing));
        Ok(ComparisonSetting {
            config: file.policy.config.clone(),
            format: self.format.clone(),
            nodes: nodes.into(),
            unseen: unseen.collect(),
            rounds: options.federation.rounds,
            training: options.federation.training(),
            same_steps: options.same_steps,
            measured,
        })
    }

    /// The start of all variants. Random weights differ by seed; the frozen half does not.
    pub fn start(&self, options: &CompareOptions, seed: u64) -> Result<ExpertWeights> {
        if options.federation.starts_at_random() {
            return Ok(options.federation.source(seed)?.policy()?.expert);
        }
        Ok(self.opened.file.policy.expert.clone())
    }
}

/// Refuses recordings that share an episode: training would see held-out or unseen data.
fn no_episode_twice<'a>(recordings: impl Iterator<Item = &'a SampledRecording>) -> Result<()> {
    let mut known = BTreeMap::new();
    for recorded in recordings {
        for (number, digest) in recorded.episode_digests.iter().enumerate() {
            let here = format!("episode {number} of {}", recorded.name);
            if let Some(there) = known.get(digest) {
                bail!("{here} is the same as {there}: nobody could be measured on it who has not trained on it. Name each recording once, and none that holds episodes of another");
            }
            known.insert(*digest, here);
        }
    }
    Ok(())
}
