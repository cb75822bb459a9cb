//! A network's founding policy folder, and copies with a round's weights.

use crate::dataset::RecordingName;
use crate::policy::whole_folder;
use anyhow::{bail, Context, Result};
use std::path::{Path, PathBuf};
use zk0_circuits::{Digest, EvalSpec};
use zk0_ledger::blobs::Blobs;
use zk0_lerobot::dataset::Stats;
use zk0_lerobot::policy_folder::{PolicyFolder, Precision};
use zk0_node::exchanged_weights::Base;
use zk0_protocol::Genesis;
use zk0_smolvla::policy::policy_file;
use zk0_smolvla::Policy;
use zk0_tensors::{encode, TensorSet};
use zk0_weights::Format;

/// The founding policy folder.
pub struct NetworkFolder {
    source: PolicyFolder,
    /// Of the copies, instead of the folder's.
    stats: Option<Stats>,
    format: Format,
    blobs: Blobs,
}

impl NetworkFolder {
    /// Opens `policy`, and compares it with the network's. Copies get the statistics of the recording `statistics_of`.
    ///
    /// # Errors
    /// The policy folder cannot be read or is not the founding one; it has no statistics, and no recording is named; or the recording
    /// cannot be read or does not fit.
    pub fn open(
        policy: &Path,
        genesis: &Genesis,
        blobs: &Blobs,
        statistics_of: Option<&RecordingName>,
    ) -> Result<Self> {
        let source = PolicyFolder::open(policy)?;
        if founded_with(genesis, blobs)? != Policy::from_folder(&source)? {
            bail!(
                "{} is not the policy that the network was founded with: name the folder that `zk0 aggregator init --policy` had",
                policy.display()
            );
        }
        let stats = match statistics_of {
            Some(recording) => {
                let stats = recording.open()?.stats().clone();
                source.check_takes(&stats)?;
                Some(stats)
            }
            None => {
                source.check_has_statistics().context(
                    "name the recording of the robot that is to use the policy: its statistics go into the folder (--statistics-of RECORDING, \
                     or --checkpoint-statistics-of of `zk0 aggregator serve`)",
                )?;
                None
            }
        };
        Ok(Self {
            source,
            stats,
            format: Format::new(&EvalSpec::decode(&genesis.evaluation)?)?,
            blobs: blobs.clone(),
        })
    }

    /// Writes a copy with the weights of the blob `weights` to the new or empty folder `to`.
    ///
    /// # Errors
    /// The weights cannot be read, or the folder cannot be written.
    pub fn write_to(&self, to: &Path, weights: &Digest) -> Result<()> {
        let tensors = weights_of(&self.format, &self.source, &self.blobs, weights)?;
        match &self.stats {
            Some(stats) => self
                .source
                .write_trained(to, &tensors, stats, Precision::Kept)?,
            None => self.source.write(to, &tensors, Precision::Kept)?,
        }
        Ok(())
    }

    /// Writes such a copy as the folder `name` in `out`, whole or not at all. `more` may add files first.
    ///
    /// # Errors
    /// Those of [`Self::write_to`] and of `more`.
    pub fn write(
        &self,
        out: &Path,
        name: &str,
        weights: &Digest,
        more: impl FnOnce(&Path) -> Result<()>,
    ) -> Result<PathBuf> {
        whole_folder::write(out, name, |to| {
            self.write_to(to, weights)?;
            more(to)
        })
    }

    /// Whether the policy folder `copy` holds the weights of the blob `weights`.
    ///
    /// # Errors
    /// The weights or the folder cannot be read.
    pub fn is_copy_with(&self, copy: &Path, weights: &Digest) -> Result<bool> {
        let copy = PolicyFolder::open(copy)?;
        Ok(other_tensors(&self.format, &copy, &self.blobs, weights)?.is_empty())
    }
}

/// The genesis's policy.
///
/// # Errors
/// Its blob is missing, is damaged, or holds no policy.
pub fn founded_with(genesis: &Genesis, blobs: &Blobs) -> Result<Policy> {
    blobs.check(&genesis.policy)?;
    Ok(policy_file::load(&blobs.path(&genesis.policy))?.policy)
}

/// In float32.
///
/// # Errors
/// The blob is missing, is damaged, or holds other weights.
fn weights_of(
    format: &Format,
    folder: &PolicyFolder,
    blobs: &Blobs,
    weights: &Digest,
) -> Result<TensorSet> {
    let file = blobs.get(weights, format.file_bytes())?;
    let base = Base::read(format, &folder.config().dims, &file)?;
    Ok(base.weights.into_tensors())
}

/// Names the tensors of `folder` that differ from the blob `weights` in the folder's types.
///
/// # Errors
/// The blob is missing, is damaged, or holds other weights; or the folder lacks a tensor or cannot be read.
pub fn other_tensors(
    format: &Format,
    folder: &PolicyFolder,
    blobs: &Blobs,
    weights: &Digest,
) -> Result<Vec<String>> {
    let mut others = Vec::new();
    for (name, expected) in weights_of(format, folder, blobs, weights)? {
        let stored = folder.weights().info(&name);
        let dtype = stored
            .with_context(|| format!("the folder has no tensor {name}"))?
            .dtype;
        if encode(dtype, &expected.data) != encode(dtype, &folder.tensor(&name)?.data) {
            others.push(name);
        }
    }
    Ok(others)
}
