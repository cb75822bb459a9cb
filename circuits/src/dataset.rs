//! What a dataset commitment commits to.
//!
//! A *sample* is the frozen prefix's key/value cache of one frame, the normalised action chunk and its pad mask, all
//! in fixed point. Its leaf is `H(salt, Poseidon2(sample))` under one secret salt per dataset: leaves say nothing about
//! the data, yet two equal samples give two equal leaves, so that whoever holds the list of leaves (the aggregator, an
//! auditor) sees every duplicate.

use crate::Digest;
use borsh::{BorshDeserialize, BorshSerialize};

/// A commitment to an ordered set of samples; made before the round opens.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct DatasetCommitment {
    /// RFC 6962 Merkle tree hash over the leaves, in dataset order.
    pub root: Digest,
    /// Number of samples (leaves).
    pub samples: u64,
    /// Digest of the dataset's features: names, shapes, rate, cameras, chunk length.
    pub feature_spec: Digest,
    /// `H(tag, salt)`: holds the node to one salt, so that uniqueness of leaves is uniqueness of samples.
    pub salt_commitment: Digest,
}
