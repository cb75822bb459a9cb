//! A log in memory, with receipts and proofs.

use super::*;
use tlog_tiles::tlog::{prove_record, prove_tree, Error as TreeError, Hash, HashReader};
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::tlog::verifier_key::{Role, VerifierKey};
use zk0_protocol::{Checkpoint, Receipt};

/// The log's origin.
pub const ORIGIN: &str = "zk0.example/test";

/// The log's verifier key.
pub fn log_vkey() -> VerifierKey {
    VerifierKey::new(Role::Log, ORIGIN, log_key().verifying_key().as_bytes()).unwrap()
}

/// Leaves, and the tree's hashes in the order of becoming final.
pub struct MemoryLog {
    leaves: Vec<Vec<u8>>,
    hashes: Vec<Hash>,
}

impl MemoryLog {
    /// Of these leaves.
    pub fn of(leaves: &[Vec<u8>]) -> Self {
        let mut tree = Frontier::default();
        let hashes = leaves.iter().flat_map(|leaf| tree.push(leaf).unwrap());
        Self {
            hashes: hashes.collect(),
            leaves: leaves.to_vec(),
        }
    }

    /// A genesis and so many enrolments, `step_ms` apart.
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

    /// The checkpoint of `size` entries.
    pub fn checkpoint(&self, size: u64) -> Checkpoint {
        let root = tlog_tiles::tlog::tree_hash(size, self).unwrap();
        Checkpoint {
            size,
            root: Digest(root.0),
        }
    }

    /// A receipt with the whole log's checkpoint.
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

    /// The consistency proof of the first `old` and `new` entries.
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
