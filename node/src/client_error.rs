//! Why dealings with the aggregator fail.

use tonic::{transport, Status};
use zk0_circuits::Digest;
use zk0_protocol::{
    entries::codec::EntryError,
    tlog::{checkpoint::CheckpointError, receipt::ReceiptError},
};

/// What goes wrong between a node and its aggregator.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// The address is no address, or nobody answers.
    #[error("cannot be reached: {0}")]
    Connect(#[from] transport::Error),
    /// The aggregator refuses, and says why.
    #[error("{}", .0.message())]
    Refused(Box<Status>),
    /// Another network than the one asked for.
    #[error("it serves network {theirs}, not {ours}")]
    OtherNetwork {
        /// As the node was told.
        ours: Digest,
        /// As follows from the genesis it sent.
        theirs: Digest,
    },
    /// It sent what is no entry of a ledger.
    #[error("it sent a broken entry: {0}")]
    Entry(#[from] EntryError),
    /// A checkpoint that is not the log's.
    #[error("{0}")]
    Checkpoint(#[from] CheckpointError),
    /// A receipt that proves nothing.
    #[error("{0}")]
    Receipt(#[from] ReceiptError),
    /// It answered with something else than what was asked for.
    #[error("it answered with {found} where {expected} was due")]
    Unexpected {
        /// What was due.
        expected: String,
        /// What came.
        found: String,
    },
    /// A blob that is not the one asked for.
    #[error("blob {asked} has SHA-256 {actual} as it sent it")]
    OtherBlob {
        /// As asked.
        asked: Digest,
        /// As received.
        actual: Digest,
    },
    /// A blob over the limit.
    #[error("blob {blob} is longer than the {limit} bytes it may have")]
    TooLarge {
        /// Which.
        blob: Digest,
        /// The limit.
        limit: u64,
    },
    /// What was downloaded cannot be kept.
    #[error("a download cannot be kept: {0}")]
    Write(std::io::Error),
}

impl From<Status> for NodeError {
    fn from(status: Status) -> Self {
        Self::Refused(Box::new(status))
    }
}
