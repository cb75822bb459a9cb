//! Errors of blobs.

use std::io;
use std::path::{Path, PathBuf};
use zk0_circuits::Digest;

/// Why a blob cannot be stored or read.
#[derive(Debug, thiserror::Error)]
pub enum BlobError {
    /// There is no such blob.
    #[error("there is no blob {0}")]
    Missing(Digest),
    /// It is larger than the limit.
    #[error("the blob has at least {size} bytes; at most {limit} are allowed")]
    TooLarge { size: u64, limit: u64 },
    /// Not all of its bytes are here.
    #[error("the blob has {size} bytes, and {held} of them are here")]
    Incomplete { held: u64, size: u64 },
    /// Its bytes are not the announced ones, or have changed on disk.
    #[error("the blob has SHA-256 {actual}, not {expected}")]
    WrongDigest { expected: Digest, actual: Digest },
    /// The store has other bytes under its name.
    #[error("the blob store {address} does not hold blob {blob} under its name, but {found}: put the right file back there")]
    Altered {
        address: String,
        blob: Digest,
        found: String,
    },
    /// Nothing was put at an upload's address.
    #[error("nothing was put at the address of this upload: put the update there before its time is over, or upload it to the aggregator")]
    NotSent,
    /// What was put at an upload's address has another size.
    #[error(
        "{found} bytes were put at the address of this upload, and its signed request states {size}"
    )]
    OtherSize { found: u64, size: u64 },
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The file system failed.
    #[error("{path}: {error}")]
    Io { path: PathBuf, error: io::Error },
}

/// The store failed, and trying again did not help.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the blob store {address} failed: {what}: {why}")]
pub struct StoreError {
    /// Its address.
    pub address: String,
    /// What was asked for.
    pub what: String,
    /// Why it failed.
    pub why: String,
}

impl BlobError {
    /// Whether the disk has no room for the blob.
    pub fn is_full(&self) -> bool {
        use io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
        match self {
            Self::Io { error, .. } => {
                matches!(error.kind(), StorageFull | QuotaExceeded | FileTooLarge)
            }
            _ => false,
        }
    }
}

pub(crate) fn io_error(path: &Path) -> impl FnOnce(io::Error) -> BlobError + '_ {
    |error| BlobError::Io {
        path: path.into(),
        error,
    }
}
