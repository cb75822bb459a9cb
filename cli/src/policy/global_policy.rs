//! The global weights of a network's ledger as a policy folder, which LeRobot's `from_pretrained` loads. Whatever is not trained is copied from
//! the policy folder that the network was founded with.

use anyhow::{bail, Result};
use std::path::Path;
use zk0_circuits::{Digest, EvalSpec};
use zk0_ledger::blobs::Blobs;
use zk0_lerobot::policy_folder::{PolicyFolder, Precision};
use zk0_node::exchanged_weights::Base;
use zk0_protocol::entries::genesis::Genesis;
use zk0_smolvla::policy::policy_file;
use zk0_smolvla::Policy;
use zk0_weights::Format;

/// What writes such folders.
pub struct GlobalPolicy {
    source: PolicyFolder,
    format: Format,
    blobs: Blobs,
}

impl GlobalPolicy {
    /// Of the network with this genesis, whose blobs are in `blobs`. `policy` is the folder that it was founded with.
    ///
    /// # Errors
    /// The policy folder is not the one that the network was founded with, or cannot be read.
    pub fn open(policy: &Path, genesis: &Genesis, blobs: &Blobs) -> Result<Self> {
        let source = PolicyFolder::open(policy)?;
        blobs.check(&genesis.policy)?;
        let founded = policy_file::load(&blobs.path(&genesis.policy))?.policy;
        if founded != Policy::from_folder(&source)? {
            bail!(
                "{} is not the policy that the network was founded with: name the folder that `zk0 aggregator init --policy` had",
                policy.display()
            );
        }
        Ok(Self {
            source,
            format: Format::new(&EvalSpec::decode(&genesis.evaluation)?)?,
            blobs: blobs.clone(),
        })
    }

    /// Writes the policy with these weights to the new or empty folder `to`.
    ///
    /// # Errors
    /// The weights are not there, or the folder cannot be written.
    pub fn write(&self, to: &Path, weights: &Digest) -> Result<()> {
        let file = self.blobs.get(weights, self.format.file_bytes())?;
        let base = Base::read(&self.format, &self.source.config().dims, &file)?;
        Ok(self
            .source
            .write(to, base.weights.tensors(), Precision::Kept)?)
    }
}
