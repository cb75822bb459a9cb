//! Why contributions do not combine.

use zk0_circuits::{Digest, NodeId};
use zk0_weights::WeightFileError;

/// Why contributions do not combine.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CombineError {
    /// No contribution has a weight above 0.
    #[error("no contribution has any weight")]
    Empty,
    /// A node contributes twice.
    #[error("node {0} contributes twice")]
    Twice(NodeId),
    /// A contribution has another network's dimensions.
    #[error("node {0}'s weights have another size than those of this network")]
    Unlike(NodeId),
    /// The strategy's base weights were not given.
    #[error("the strategy reads the base weights of the round, and they were not given")]
    NoBase,
    /// A file cannot be read.
    #[error("the update {blob} cannot be read: {error}")]
    Unreadable {
        /// The file.
        blob: Digest,
        /// Why.
        error: String,
    },
    /// A file has changed since it was verified.
    #[error("the file of the update {blob} has changed since it was verified: tensor '{tensor}' holds other numbers")]
    Changed {
        /// The file.
        blob: Digest,
        /// The tensor.
        tensor: String,
    },
    /// The moments that the round starts with cannot be read.
    #[error("the moments {blob} that the strategy goes on from cannot be read: {error}")]
    MomentsUnreadable {
        /// Their file.
        blob: Digest,
        /// Why.
        error: String,
    },
    /// The file of the moments has another digest.
    #[error("the file of the moments that the strategy goes on from has SHA-256 {actual}, and the ledger names {expected}")]
    OtherMoments {
        /// The ledger's digest.
        expected: Digest,
        /// The file's digest.
        actual: Digest,
    },
    /// The round's new moments cannot be kept.
    #[error("the moments that the round ends with cannot be written: {0}")]
    MomentsUnwritten(String),
    /// The result is not a network's weights. No strategy gives that.
    #[error(transparent)]
    Weights(#[from] WeightFileError),
}
