//! The right edge of an RFC 6962 tree: all that is needed to append to it and to know its root.

use std::collections::BTreeMap;
use tlog_tiles::tlog::{
    stored_hashes, sub_tree_index, tree_hash, Error as TreeError, Hash, HashReader,
};
use zk0_circuits::Digest;

/// A tree of `size` leaves, known by the roots of its complete subtrees (at most log₂ of its size).
#[derive(Clone, Debug, Default)]
pub struct Frontier {
    size: u64,
    hashes: BTreeMap<u64, Hash>,
}

impl Frontier {
    /// The right edge of the first `size` leaves, from the hashes that were stored as they came.
    pub fn read(size: u64, stored: &impl HashReader) -> Result<Self, TreeError> {
        let edge = sub_tree_index(0, size, Vec::new());
        let found = stored.read_hashes(&edge)?;
        Ok(Self {
            size,
            hashes: edge.into_iter().zip(found).collect(),
        })
    }

    /// Number of leaves.
    pub fn size(&self) -> u64 {
        self.size
    }

    /// Appends a leaf. Returns the hashes that become final with it, to be stored from
    /// `tlog_tiles::tlog::stored_hash_index(0, n)` on, the leaf's own hash first.
    pub fn push(&mut self, entry: &[u8]) -> Result<Vec<Hash>, TreeError> {
        let new = stored_hashes(self.size, entry, self)?;
        let first = tlog_tiles::tlog::stored_hash_index(0, self.size);
        self.hashes.extend((first..).zip(new.iter().copied()));
        self.size += 1;
        let edge = sub_tree_index(0, self.size, Vec::new());
        self.hashes.retain(|index, _| edge.contains(index));
        Ok(new)
    }

    /// The root: RFC 6962's Merkle tree hash of all leaves.
    pub fn root(&self) -> Result<Digest, TreeError> {
        tree_hash(self.size, self).map(|hash| Digest(hash.0))
    }
}

impl HashReader for Frontier {
    fn read_hashes(&self, indexes: &[u64]) -> Result<Vec<Hash>, TreeError> {
        indexes
            .iter()
            .map(|index| self.hashes.get(index).copied())
            .collect::<Option<_>>()
            .ok_or(TreeError::IndexesNotInTree)
    }
}
