//! A set of digests in RocksDB, for what grows with the log and is asked for one by one.
//!
//! | key | value |
//! |---|---|
//! | a digest | nothing |
//! | `entries` | how many entries of the log the set covers, at least (big-endian) |

use super::on_rocksdb::options;
use crate::error::{io_error, LedgerError};
use rocksdb::{Error, WriteBatch, WriteOptions, DB};
use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use zk0_circuits::Digest;

const ENTRIES: &[u8] = b"entries";

/// A set of digests on disk.
pub struct DigestSet(DB);

impl DigestSet {
    /// Makes an empty set in `path`, in place of what is there.
    pub fn create(path: &Path) -> Result<Self, LedgerError> {
        Self::remove(path)?;
        Self::open(path)
    }

    /// Removes what is in `path`, if anything is.
    pub fn remove(path: &Path) -> Result<(), LedgerError> {
        match fs::remove_dir_all(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
            removed => removed.map_err(io_error(path)),
        }
    }

    /// Opens the set in `path`, by one process at a time.
    pub fn open(path: &Path) -> Result<Self, LedgerError> {
        let mut options = options();
        options.create_if_missing(true);
        Ok(Self(DB::open(&options, path).map_err(failed(path))?))
    }

    /// How many entries of its log the set in `path` covers, at least; 0 without a set.
    pub fn covered(path: &Path) -> Result<u64, LedgerError> {
        if !path.join("CURRENT").exists() {
            return Ok(0);
        }
        let set = DB::open_for_read_only(&options(), path, false).map_err(failed(path))?;
        let entries = set.get(ENTRIES).map_err(failed(path))?;
        let entries = entries.and_then(|entries| entries.try_into().ok());
        Ok(entries.map_or(0, u64::from_be_bytes))
    }

    /// Whether the set has this digest.
    pub fn contains(&self, digest: &Digest) -> Result<bool, LedgerError> {
        let found = self.0.get(digest.0).map_err(failed(self.0.path()))?;
        Ok(found.is_some())
    }

    /// Adds digests, after which the set covers this many entries. All or nothing, durably.
    pub fn extend(&self, digests: &[Digest], entries: u64) -> Result<(), LedgerError> {
        let mut batch = WriteBatch::default();
        for digest in digests {
            batch.put(digest.0, b"");
        }
        batch.put(ENTRIES, entries.to_be_bytes());
        let mut durable = WriteOptions::default();
        durable.set_sync(true);
        let written = self.0.write_opt(batch, &durable);
        written.map_err(failed(self.0.path()))
    }
}

/// The error of RocksDB, with what to do.
fn failed(path: &Path) -> impl FnOnce(Error) -> LedgerError + '_ {
    move |error| LedgerError::PublicSet {
        path: path.into(),
        why: error.to_string(),
    }
}
