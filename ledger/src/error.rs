//! Errors of a ledger.

use crate::blobs::BlobError;
use crate::clock::ClockError;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use tlog_tiles::tlog::Error as TreeError;
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::entries::codec::EntryError;
use zk0_protocol::rules::violation::RuleViolation;
use zk0_protocol::tlog::checkpoint::CheckpointError;

/// Why a ledger cannot be opened, read or extended.
#[derive(Debug, thiserror::Error)]
pub enum LedgerError {
    /// The rules refuse the entry. Nothing was written.
    #[error(transparent)]
    Rule(#[from] RuleViolation),
    /// The clock seems wrong. Nothing was written.
    #[error(transparent)]
    Clock(#[from] ClockError),
    /// Another process has the ledger open.
    #[error("the ledger in {0} is in use by another process: stop that process first")]
    Locked(PathBuf),
    /// The folder holds no ledger.
    #[error("there is no ledger in {0}")]
    NoLedger(PathBuf),
    /// The database is empty. An import makes it first.
    #[error("there is no ledger in {0} yet: its database is empty. If `zk0 ledger import` was interrupted there, run it again")]
    Unfinished(PathBuf),
    /// The folder already holds a ledger.
    #[error("{0} already holds a ledger: open it, or choose another folder")]
    AlreadyExists(PathBuf),
    /// The ledger is of another network.
    #[error("the ledger in {dir} is of network {found}, not of network {expected}: choose the right folder")]
    OtherNetwork {
        dir: PathBuf,
        found: Digest,
        expected: Digest,
    },
    /// The key is not the log's key.
    #[error("the signing key is not the log key of network {0}")]
    OtherKey(Digest),
    /// The operator has given the log another key since.
    #[error("the signing key was the log key of network {0}, and its operator has given the log another one: name the file of the present key. Nothing is signed")]
    FormerKey(Digest),
    /// The key did not found the network.
    #[error("the operator's key did not found network {0}, so it cannot give its log another key: name the file of the key that founded it. Nothing was signed")]
    NotOperatorsKey(Digest),
    /// The database lacks entries that the log has signed.
    #[error("the database holds {held} entries, but the log has signed a checkpoint of {signed} entries: the database was rolled back or damaged. Restore the newest copy; until then nothing is signed")]
    RolledBack { held: u64, signed: u64 },
    /// The database's history differs from the signed one.
    #[error("the first {size} entries have root {found}, but the log has signed root {signed}: the history was changed. Restore the true one; until then nothing is signed")]
    Forked {
        size: u64,
        found: Digest,
        signed: Digest,
    },
    /// A former key has signed a checkpoint in the folder that the database does not have.
    #[error("{path} holds a checkpoint of {signed} entries that this database of {held} entries does not have, and a former key of the log has signed it, which may be stolen. If no backup, mirror or witness has more entries under the present key, put the newest checkpoint that they have in its place (a file `cosigned` may also be removed); until then nothing is signed")]
    ByFormerKey {
        path: PathBuf,
        signed: u64,
        held: u64,
    },
    /// The checkpoint file is missing.
    #[error("{0} is missing, but the database holds entries. Put the newest signed checkpoint back; until then nothing is signed. If this is a copy and `zk0 ledger import` was interrupted there, run it again")]
    NoCheckpoint(PathBuf),
    /// A stored checkpoint is invalid.
    #[error("checkpoint of size {size}: {error}")]
    Checkpoint { size: u64, error: CheckpointError },
    /// The checkpoint file holds no valid checkpoint of the log.
    #[error("{path}: {error}")]
    CheckpointFile {
        path: PathBuf,
        error: CheckpointError,
    },
    /// The policy file holds no policy.
    #[error("{path}: {why}")]
    BadPolicy { path: PathBuf, why: String },
    /// The statement about pruned blobs does not count.
    #[error("{from} does not hold a statement about pruned blobs that counts: {why}. Put it back from an export or a mirror, or remove it and prune again")]
    BadPruning { from: String, why: String },
    /// A key that the log has no more has signed the statement about pruned blobs, or one that it never had.
    #[error("{from}: {signer} has signed what was pruned, and the log's present key is {present}, so it does not count. If a change of the key was interrupted, run `zk0 aggregator rotate-log-key` with the same keys again. Otherwise put the file back from an export or a mirror, or remove it and prune again. Nothing was signed or deleted")]
    FormerPruning {
        from: String,
        signer: NodeId,
        present: NodeId,
    },
    /// The store holds something else in place of the statement about pruned blobs.
    #[error("the object `pruned` in the blob store {address} is no statement of this log about pruned blobs: {why}. Put the right one back. If there is none, remove the object: the next start puts the folder's there, if that has one. Nothing was signed or deleted")]
    StoredPruning { address: String, why: String },
    /// The operator's statement covers blobs that only later entries named.
    #[error("ROLLED BACK: the log's operator has signed a statement about pruned blobs and {signed} entries, but there are {held}")]
    PrunedMore { signed: u64, held: u64 },
    /// The store of the blobs has other entries where this ledger goes on.
    #[error("the blob store {address} holds another entry {index} than this ledger, so another aggregator writes the same log. Stop one of the two. To go on here, start again with the same command, which takes the entries from the store; if it ends like this once more, move the ledger's folder away first")]
    OtherEntries { address: String, index: u64 },
    /// The store of the blobs has a statement about pruned blobs that this ledger's does not include.
    #[error("another aggregator of this log has pruned more from the blob store {0}, so nothing is deleted: stop one of the two, and start the other again")]
    PrunedElsewhere(String),
    /// There is no ledger, neither in the folder nor in the store.
    #[error("there is no ledger in {dir}, and the blob store {address} holds no entries of one: name the right folder or store, or found a network with `zk0 aggregator init`")]
    NoEntries { dir: PathBuf, address: String },
    /// The store overwrites what it is asked to create.
    #[error("the blob store {0} overwrites an object that it is asked to create (it ignores `If-None-Match: *`), so two aggregators could write one log there: use another store")]
    NoFence(String),
    /// The log in the store has another key.
    #[error("the blob store {address} holds the log of network {network}, and the signing key is not its log key: name the right key or store")]
    EntriesOfOther { address: String, network: Digest },
    /// The store lacks entries before later ones.
    #[error("the blob store {address} lacks the object `{object}`, and has entries that come later: put the object back. Nothing was changed there")]
    MissingEntries { address: String, object: String },
    /// An object in the store does not continue the log.
    #[error("the object `{object}` in the blob store {address} does not continue the log: {why}. If it is damaged, put the right one back. Otherwise another aggregator writes the same log: stop one of the two. Nothing was changed there")]
    BadEntries {
        address: String,
        object: String,
        why: String,
    },
    /// A log of the database's size does not have this key.
    #[error("the database holds {found}, which does not belong in a log of {size} entries")]
    StrayKey { found: String, size: u64 },
    /// The checkpoint file does not hold the database's newest checkpoint.
    #[error("{path} holds a checkpoint of {published} entries, but the database has {size} entries. {}", if_published(*published, *size))]
    OtherPublished {
        path: PathBuf,
        published: u64,
        size: u64,
    },
    /// A stored entry is invalid at its place.
    #[error("entry {index}: {why}")]
    BadEntry { index: u64, why: String },
    /// A write failed. What is on disk is unknown until the next opening.
    #[error("an earlier write to the ledger failed, so nothing more is written: see to the disk, and start again")]
    Poisoned,
    /// The log has no such entry.
    #[error("there is no entry {0}")]
    NoEntry(u64),
    /// No group of entries ended at this size.
    #[error("the log has no checkpoint of {0} entries")]
    NoCheckpointAt(u64),
    /// The tree's hashes are missing or wrong.
    #[error("tree: {0}")]
    Tree(String),
    /// An auditor's build cannot read the folder's RocksDB database.
    #[error("{0} has a database of RocksDB, which this build of zk0 cannot read: name an export of the ledger (`zk0 ledger export`) or the address of the served log, or build zk0 with RocksDB (`cargo build --release --locked -p zk0 --no-default-features --features audit,rocksdb`)")]
    NeedsRocksDb(PathBuf),
    /// The database failed.
    #[error("database: {0}")]
    Database(#[from] DatabaseError),
    /// The set of the public blobs, which belongs to a kept state, cannot be read or written.
    #[error(
        "{path}: {why}. Delete this folder and start again: the whole history is then replayed"
    )]
    PublicSet { path: PathBuf, why: String },
    /// A blob cannot be read or written.
    #[error(transparent)]
    Blob(#[from] BlobError),
    /// The file system failed.
    #[error("{path}: {error}")]
    Io { path: PathBuf, error: io::Error },
}

/// Why a database of either kind failed.
#[derive(Debug)]
pub struct DatabaseError {
    failure: DatabaseFailure,
    text: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DatabaseFailure {
    /// Disk or file system.
    OfDisk,
    /// Missing or damaged files.
    Damaged,
    Other,
}

impl DatabaseError {
    pub(crate) fn new(failure: DatabaseFailure, text: impl ToString) -> Self {
        let text = text.to_string();
        Self { failure, text }
    }
}

impl fmt::Display for DatabaseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)?;
        match self.failure {
            DatabaseFailure::Damaged => f.write_str(
                ". If files of the database are missing or damaged, restore the newest copy",
            ),
            DatabaseFailure::OfDisk | DatabaseFailure::Other => Ok(()),
        }
    }
}

impl std::error::Error for DatabaseError {}

impl LedgerError {
    /// Whether the entries in the store, or what was pruned of them, are not this ledger's. A start again cannot help.
    pub fn is_of_stored_entries(&self) -> bool {
        matches!(
            self,
            Self::OtherEntries { .. }
                | Self::MissingEntries { .. }
                | Self::BadEntries { .. }
                | Self::StoredPruning { .. }
        )
    }

    /// Whether the ledger is just unreadable here and now: a disk failed, another process writes to it, or this build lacks its database.
    pub(crate) fn is_of_reading(&self) -> bool {
        match self {
            Self::Io { .. } | Self::Locked(_) | Self::NeedsRocksDb(_) => true,
            Self::Database(error) => error.failure == DatabaseFailure::OfDisk,
            _ => false,
        }
    }
}

/// Advice if the database's checkpoint is not the published one.
fn if_published(published: u64, size: u64) -> &'static str {
    if published < size {
        "If the aggregator was killed, start it once. If this is a copy and `zk0 ledger import` was interrupted there, run it again"
    } else {
        "The database was rolled back or damaged: restore the newest copy"
    }
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
