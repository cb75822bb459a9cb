//! The right edge of an RFC 6962 tree: enough to append leaves and to compute the root.

use tlog_tiles::tlog::{
    node_hash, record_hash, sub_tree_index, Error as TreeError, Hash, HashReader, EMPTY_HASH,
};
use zk0_circuits::Digest;

/// Most leaves: positions of the hashes stay well within 64 bits.
const MAX_LEAVES: u64 = 1 << 60;

/// A tree of `size` leaves, as the roots of its complete subtrees, at most log₂ of `size`.
#[derive(Clone, Debug, Default)]
pub struct Frontier {
    size: u64,
    /// One root for each one bit of `size`, the largest subtree first.
    edge: Vec<Hash>,
}

impl Frontier {
    /// The right edge of the first `size` leaves, from stored hashes.
    pub fn read(size: u64, stored: &impl HashReader) -> Result<Self, TreeError> {
        let edge = stored.read_hashes(&sub_tree_index(0, size, Vec::new()))?;
        Ok(Self { size, edge })
    }

    /// Number of leaves.
    pub fn size(&self) -> u64 {
        self.size
    }

    /// Appends a leaf. Returns the hashes that become final, the leaf's own first, for consecutive positions from
    /// `tlog_tiles::tlog::stored_hash_index(0, n)` on. A tree has at most 2⁶⁰ leaves.
    pub fn push(&mut self, entry: &[u8]) -> Result<Vec<Hash>, TreeError> {
        self.push_leaf(record_hash(entry))
    }

    /// [`Frontier::push`] of a leaf with a known hash (`tlog_tiles::tlog::record_hash`).
    pub fn push_leaf(&mut self, leaf: Hash) -> Result<Vec<Hash>, TreeError> {
        if self.size >= MAX_LEAVES {
            return Err(TreeError::InvalidInput(format!(
                "a tree has at most {MAX_LEAVES} leaves"
            )));
        }
        let mut new = vec![leaf];
        let mut hash = leaf;
        // For each trailing one bit of the size, a subtree of twice the size is complete.
        for _ in 0..self.size.trailing_ones() {
            let left = self.edge.pop().ok_or(TreeError::IndexesNotInTree)?;
            hash = node_hash(left, hash);
            new.push(hash);
        }
        self.edge.push(hash);
        self.size += 1;
        Ok(new)
    }

    /// The RFC 6962 Merkle tree hash of all leaves.
    pub fn root(&self) -> Result<Digest, TreeError> {
        let mut subtrees = self.edge.iter().rev();
        let Some(smallest) = subtrees.next() else {
            return Ok(Digest(EMPTY_HASH.0));
        };
        let root = subtrees.fold(*smallest, |right, left| node_hash(*left, right));
        Ok(Digest(root.0))
    }
}
