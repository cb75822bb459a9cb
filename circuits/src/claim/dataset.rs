//! What a dataset commitment commits to.
//!
//! A *sample* is the frozen prefix's key/value cache of one frame, the normalised action chunk and its pad mask, all
//! in fixed point. Its leaf is `H(salt, Poseidon2(sample))` under one secret salt per dataset. Leaves state nothing about
//! the data. Two equal samples give two equal leaves, so that whoever holds the list of leaves (the aggregator, an auditor)
//! sees every duplicate.

use crate::vm::digest::{tagged_sha256, Digest};
use crate::vm::merkle;
use alloc::vec::Vec;
use borsh::{BorshDeserialize, BorshSerialize};

/// A commitment to an ordered set of samples, made before the round opens.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct DatasetCommitment {
    /// RFC 6962 Merkle tree hash over the leaves, in dataset order.
    pub root: Digest,
    /// Number of samples (leaves).
    pub samples: u64,
    /// Digest of the dataset's features: names, shapes, rate, cameras, chunk length.
    pub feature_spec: Digest,
    /// `H(tag, salt)`. It holds the node to one salt, so that different leaves are different samples.
    pub salt_commitment: Digest,
}

/// Leaf hash of a sample: the RFC 6962 leaf hash of `H(tag, salt, Poseidon2(sample))`.
pub fn leaf(salt: &[u8; 32], sample: &Digest) -> Digest {
    merkle::leaf_hash(&tagged_sha256("zk0/sample-leaf/v1", &[salt, &sample.0]).0)
}

/// What [`DatasetCommitment::salt_commitment`] holds for `salt`.
pub fn salt_commitment(salt: &[u8; 32]) -> Digest {
    tagged_sha256("zk0/dataset-salt/v1", &[salt])
}

/// Why a list of leaves does not match a commitment.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LeavesError {
    /// The number of leaves differs.
    #[error("the dataset commitment counts {committed} samples, but the list has {listed} leaves")]
    Count {
        /// Samples in the commitment.
        committed: u64,
        /// Leaves in the list.
        listed: u64,
    },
    /// The root differs.
    #[error("the leaves hash to root {listed}, but the commitment says {committed}")]
    Root {
        /// Root in the commitment.
        committed: Digest,
        /// Root over the list.
        listed: Digest,
    },
    /// A sample is there twice.
    #[error("samples {first} and {second} are the same: every sample of a dataset must be unique")]
    Duplicate {
        /// Index of one.
        first: u64,
        /// Index of the other.
        second: u64,
    },
}

/// Checks a list of leaf hashes against a commitment: count, root and uniqueness. One salt per dataset makes equal
/// samples equal leaves, so whoever holds this list sees every duplicate without seeing any data.
pub fn check_leaves(commitment: &DatasetCommitment, leaves: &[Digest]) -> Result<(), LeavesError> {
    let listed = leaves.len() as u64;
    if listed != commitment.samples {
        let committed = commitment.samples;
        return Err(LeavesError::Count { committed, listed });
    }
    let mut order: Vec<usize> = (0..leaves.len()).collect();
    order.sort_unstable_by_key(|&index| (leaves[index], index));
    for pair in order.windows(2) {
        if leaves[pair[0]] == leaves[pair[1]] {
            let (first, second) = (pair[0] as u64, pair[1] as u64);
            return Err(LeavesError::Duplicate { first, second });
        }
    }
    let root = merkle::root(leaves);
    if root != commitment.root {
        let committed = commitment.root;
        return Err(LeavesError::Root {
            committed,
            listed: root,
        });
    }
    Ok(())
}
