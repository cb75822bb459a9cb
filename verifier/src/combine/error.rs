//! Why contributions do not combine.

use zk0_circuits::{Digest, NodeId};
use zk0_weights::WeightsError;

/// Why contributions do not combine.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CombineError {
    /// No contribution has a weight above 0.
    #[error("no contribution has any weight")]
    Empty,
    /// A node contributes twice.
    #[error("node {0} contributes twice")]
    Twice(NodeId),
    /// A contribution is of another network's dimensions.
    #[error("node {0}'s weights have another size than those of this network")]
    Unlike(NodeId),
    /// The strategy reads base weights that were not given.
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
    /// A file holds other numbers than when it was verified.
    #[error("the file of the update {blob} has changed since it was verified: tensor '{tensor}' holds other numbers")]
    Changed {
        /// The file.
        blob: Digest,
        /// Where.
        tensor: String,
    },
    /// The result is not among the weights that a network can have. No strategy can give that.
    #[error(transparent)]
    Weights(#[from] WeightsError),
}
