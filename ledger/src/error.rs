//! Why a ledger cannot be opened, read or extended.

use crate::{blobs::BlobError, clock::ClockError};
use std::{
    io,
    path::{Path, PathBuf},
};
use tlog_tiles::tlog::Error as TreeError;
use zk0_circuits::Digest;
use zk0_protocol::{
    entries::codec::EntryError, rules::violation::RuleViolation, tlog::checkpoint::CheckpointError,
};

/// Why a ledger cannot be opened, read or extended.
#[derive(Debug, thiserror::Error)]
pub enum LedgerError {
    /// The rules refuse the entry; nothing was written.
    #[error(transparent)]
    Rule(#[from] RuleViolation),
    /// The rules refuse an entry of a group; nothing of the group was written.
    #[error(
        "entry {at} (from 0) of a group of {of}: {violation}; nothing of the group was recorded"
    )]
    InGroup {
        at: usize,
        of: usize,
        violation: RuleViolation,
    },
    /// The clock cannot be believed; nothing was written.
    #[error(transparent)]
    Clock(#[from] ClockError),
    /// Another process has it open.
    #[error("the ledger in {0} is in use by another process: stop that one first")]
    Locked(PathBuf),
    /// Nothing there.
    #[error("there is no ledger in {0}")]
    NoLedger(PathBuf),
    /// Something there already.
    #[error("{0} already holds a ledger: open it, or choose another folder")]
    AlreadyExists(PathBuf),
    /// Of another network.
    #[error("the ledger in {dir} is of network {found}, not of {expected}: choose that network's folder")]
    OtherNetwork {
        dir: PathBuf,
        found: Digest,
        expected: Digest,
    },
    /// The key is not the one named in the genesis.
    #[error("the signing key is not the log key of network {0}")]
    OtherKey(Digest),
    /// The database lacks what was signed.
    #[error("the database holds {held} entries, but a checkpoint of {signed} is signed: it was rolled back or damaged; restore the newest copy, nothing will be signed until then")]
    RolledBack { held: u64, signed: u64 },
    /// The database has another history than what was signed.
    #[error("the first {size} entries have root {found}, but {signed} is signed: the history was changed; restore the true one, nothing will be signed until then")]
    Forked {
        size: u64,
        found: Digest,
        signed: Digest,
    },
    /// The checkpoint file is gone.
    #[error("{0} is missing, but the database holds entries: put the newest signed checkpoint back, nothing will be signed until then")]
    NoCheckpoint(PathBuf),
    /// A checkpoint is not the log's.
    #[error("checkpoint of size {size}: {error}")]
    Checkpoint { size: u64, error: CheckpointError },
    /// The checkpoint file is not the log's.
    #[error("{path}: {error}")]
    CheckpointFile {
        path: PathBuf,
        error: CheckpointError,
    },
    /// The policy file is none.
    #[error("{path}: {why}")]
    BadPolicy { path: PathBuf, why: String },
    /// The checkpoint file is not the newest stored checkpoint.
    #[error("{path} (of size {published}) is not the newest checkpoint in the database (of size {size}): if the aggregator was killed, start it once")]
    OtherPublished {
        path: PathBuf,
        published: u64,
        size: u64,
    },
    /// An entry that does not belong where it is.
    #[error("entry {index}: {why}")]
    BadEntry { index: u64, why: String },
    /// A write failed before: what is on disk has to be read again.
    #[error("an earlier write failed: open the ledger again")]
    Poisoned,
    /// Not an entry of this log.
    #[error("there is no entry {0}")]
    NoEntry(u64),
    /// No group ended there.
    #[error("the log has no checkpoint of {0} entries")]
    NoCheckpointAt(u64),
    /// The tree's hashes do not add up.
    #[error("tree: {0}")]
    Tree(String),
    /// The database.
    #[error("database: {0}")]
    Database(#[from] rocksdb::Error),
    /// The blobs.
    #[error(transparent)]
    Blob(#[from] BlobError),
    /// The file system.
    #[error("{path}: {error}")]
    Io { path: PathBuf, error: io::Error },
}

impl From<TreeError> for LedgerError {
    fn from(error: TreeError) -> Self {
        Self::Tree(error.to_string())
    }
}

impl From<EntryError> for LedgerError {
    fn from(error: EntryError) -> Self {
        Self::Rule(error.into())
    }
}

pub(crate) fn io_error(path: &Path) -> impl FnOnce(io::Error) -> LedgerError + '_ {
    |error| LedgerError::Io {
        path: path.into(),
        error,
    }
}
