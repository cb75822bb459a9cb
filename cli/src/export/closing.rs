//! The entry that closes a round, and its inclusion proof.

use anyhow::{bail, Context, Result};
use std::path::Path;
use zk0_audit::log_source::{open_log, Trust};
use zk0_circuits::Digest;
use zk0_protocol::entries::entry::{Body, RoundClosed};
use zk0_protocol::tlog::tlog_proof::TlogProof;
use zk0_protocol::{Entry, Genesis};

/// How a round closed.
pub struct ClosingProof {
    /// The network's first entry.
    pub genesis: Genesis,
    /// The entry's content.
    pub closed: RoundClosed,
    /// Its inclusion proof.
    pub proof: TlogProof,
}

impl ClosingProof {
    /// Finds the closing of `round` under the newest checkpoint in `dir`.
    ///
    /// # Errors
    /// The log cannot be read, its checkpoint is not signed as `trust` wants it, or the round has not closed.
    pub fn find(dir: &Path, trust: &Trust, round: u64) -> Result<Self> {
        let from = dir.to_str().context("the ledger's path is not UTF-8")?;
        open_log(from, trust, |log, key, policy| -> Result<Self> {
            let (mut genesis, mut bundle, mut index) = (None, 0, 0);
            while index < log.checkpoint().size {
                for bytes in log.entries(bundle)? {
                    match Entry::decode(&bytes)?.body {
                        Body::Genesis(first) if index == 0 => genesis = Some(first),
                        Body::RoundClosed(closed) if closed.round == round => {
                            let proof = log.prove(index)?;
                            // Only a valid proof is handed out.
                            proof.verify(key, policy)?;
                            return Ok(Self {
                                genesis: genesis
                                    .context("the log's first entry is not a genesis")?,
                                closed,
                                proof,
                            });
                        }
                        _ => {}
                    }
                    index += 1;
                }
                bundle += 1;
            }
            bail!(
                "round {round} has not closed among the {index} entries that the log's newest checkpoint covers: `zk0 audit show LEDGER` lists the \
                 rounds"
            )
        })
    }

    /// SHA-256 of the global weights' blob.
    pub fn weights(&self) -> Digest {
        self.closed.global.blob
    }
}
