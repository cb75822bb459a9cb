//! Why a log cannot be mirrored.

use crate::blobs::BlobError;
use crate::error::LedgerError;
use crate::published::reader::PublishedError;
use crate::published::source::SourceError;
use zk0_circuits::Digest;
use zk0_protocol::entries::codec::EntryError;

/// Why a log cannot be mirrored.
#[derive(Debug, thiserror::Error)]
pub enum MirrorError {
    /// The published log is not valid.
    #[error(transparent)]
    Published(#[from] PublishedError),
    /// The mirror's folder is unreadable or not writable.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// A served blob is too large or has the wrong digest.
    #[error("{path}: {error}")]
    WrongBlob { path: String, error: BlobError },
    /// The published checkpoint lacks required cosignatures.
    #[error("the published checkpoint lacks cosignatures that the network's rules require: {0}")]
    Witnesses(String),
    /// A former key of the log has signed the published checkpoint.
    #[error("the published checkpoint of {size} entries is signed with a former key of the log, which may be stolen: its operator has given the log another key")]
    FormerKey { size: u64 },
    /// The checkpoint after an entry is not valid.
    #[error("the checkpoint after entry {index}: {why}")]
    Checkpoint { index: u64, why: String },
    /// The served statement about pruned blobs covers more entries than the checkpoint. An export writes the statement first, so this
    /// passes when the export ends, and is no verdict. In a mirror, the fault would last.
    #[error(
        "the log is being updated: its statement about pruned blobs is about {entries} entries, but the checkpoint is of {size}. Try again \
         later. If this stays, an update of the log was interrupted, or entries are gone: ask its operator to export the log again"
    )]
    BeingUpdated {
        network: Digest,
        entries: u64,
        size: u64,
    },
}

impl From<SourceError> for MirrorError {
    fn from(error: SourceError) -> Self {
        Self::Published(error.into())
    }
}

impl From<EntryError> for MirrorError {
    fn from(error: EntryError) -> Self {
        Self::Ledger(error.into())
    }
}

impl From<BlobError> for MirrorError {
    fn from(error: BlobError) -> Self {
        Self::Ledger(error.into())
    }
}
