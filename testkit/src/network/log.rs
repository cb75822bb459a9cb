//! A log in memory, with receipts and proofs.

use super::*;
use tlog_tiles::tlog::{prove_record, prove_tree, Error as TreeError, Hash, HashReader};
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::tlog::verifier_key::{Role, VerifierKey};
use zk0_protocol::{Checkpoint, Receipt};

/// The origin of the log.
pub const ORIGIN: &str = "zk0.example/test";

/// The verifier key of the log.
pub fn log_vkey() -> VerifierKey {
    VerifierKey::new(Role::Log, ORIGIN, log_key().verifying_key().as_bytes()).unwrap()
}

/// The leaves of a log, and every hash of its tree in the order in which they become final.
pub struct MemoryLog {
    leaves: Vec<Vec<u8>>,
    hashes: Vec<Hash>,
}

impl MemoryLog {
    /// A log of these leaves.
    pub fn of(leaves: &[Vec<u8>]) -> Self {
        let mut tree = Frontier::default();
        let hashes = leaves.iter().flat_map(|leaf| tree.push(leaf).unwrap());
        Self {
            hashes: hashes.collect(),
            leaves: leaves.to_vec(),
        }
    }

    /// Returns a genesis and this many enrolments, each `step_ms` after the one before.
    pub fn of_enrolments(nodes: u8, step_ms: u64) -> Self {
        let bodies = std::iter::once(Body::Genesis(genesis())).chain((0..nodes).map(enrolled));
        let times = (T0..).step_by(step_ms.max(1) as usize);
        let leaves: Vec<_> = times
            .zip(bodies)
            .map(|(time_ms, body)| {
                let time_ms = if step_ms == 0 { T0 } else { time_ms };
                entry(time_ms, body).encode().unwrap()
            })
            .collect();
        Self::of(&leaves)
    }

    /// The checkpoint of the first `size` entries.
    pub fn checkpoint(&self, size: u64) -> Checkpoint {
        let root = tlog_tiles::tlog::tree_hash(size, self).unwrap();
        Checkpoint {
            size,
            root: Digest(root.0),
        }
    }

    /// The receipt of an entry, with the signed checkpoint of the whole log.
    pub fn receipt(&self, index: u64) -> Receipt {
        let size = self.leaves.len() as u64;
        let proof = prove_record(size, index, self).unwrap();
        Receipt {
            index,
            entry: self.leaves[index as usize].clone(),
            checkpoint: self.checkpoint(size).sign(ORIGIN, &log_key()).unwrap(),
            proof: proof.into_iter().map(|hash| Digest(hash.0)).collect(),
        }
    }

    /// The consistency proof between the trees of the first `old` and the first `new` entries.
    pub fn consistency(&self, old: u64, new: u64) -> Vec<Digest> {
        let proof = prove_tree(new, old, self).unwrap();
        proof.into_iter().map(|hash| Digest(hash.0)).collect()
    }
}

impl HashReader for MemoryLog {
    fn read_hashes(&self, positions: &[u64]) -> Result<Vec<Hash>, TreeError> {
        let read = |position: &u64| self.hashes.get(*position as usize).copied();
        let read: Option<Vec<_>> = positions.iter().map(read).collect();
        read.ok_or(TreeError::IndexesNotInTree)
    }
}
