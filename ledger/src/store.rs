//! The log on disk: a database of entries, their tree's hashes, and a signed checkpoint where a group ended ([`crate::group`]). It is
//! RocksDB's, or plain files from a build without it.

#[cfg(feature = "rocksdb")]
pub mod digest_set;
mod engine;
mod on_files;
#[cfg(feature = "rocksdb")]
mod on_rocksdb;
pub mod reader;

pub use engine::DatabaseKey;

use crate::error::LedgerError;
use engine::Engine;
use on_files::Files;
#[cfg(feature = "rocksdb")]
use on_rocksdb::RocksDb;
use std::path::Path;
use tlog_tiles::tlog::{stored_hash_index, tree_hash, Error as TreeError, Hash, HashReader};
use zk0_circuits::Digest;
use zk0_protocol::tlog::checkpoint::Checkpoint;
use zk0_protocol::tlog::tree::Frontier;

/// The database under a ledger.
pub struct Store(Box<dyn Engine>);

/// What [`Store::commit`] writes at once.
#[derive(Default)]
pub struct StoreBatch(Vec<(DatabaseKey, Vec<u8>)>);

impl StoreBatch {
    /// Entry `index` and the hashes that become final with it ([`zk0_protocol::tlog::tree::Frontier::push`]).
    pub fn entry(&mut self, index: u64, entry: &[u8], hashes: &[Hash]) {
        self.put(DatabaseKey::Entry(index), entry);
        for (position, hash) in (stored_hash_index(0, index)..).zip(hashes) {
            self.put(DatabaseKey::Hash(position), &hash.0);
        }
    }

    /// The signed checkpoint of the first `size` entries.
    pub fn checkpoint(&mut self, size: u64, text: &[u8]) {
        self.put(DatabaseKey::Checkpoint(size), text);
    }

    /// The keys and values, in order of addition.
    pub(crate) fn items(&self) -> &[(DatabaseKey, Vec<u8>)] {
        &self.0
    }

    fn put(&mut self, key: DatabaseKey, value: &[u8]) {
        self.0.push((key, value.into()));
    }
}

impl Store {
    /// Whether the folder `path` has a database, completely made.
    pub fn is_in(path: &Path) -> bool {
        is_rocksdb(path) || on_files::is_in(path)
    }

    /// Opens a database for writing, by one process at a time. A new one is RocksDB's if this build has it.
    pub fn open(path: &Path) -> Result<Self, LedgerError> {
        #[cfg(feature = "rocksdb")]
        if is_rocksdb(path) || !on_files::is_in(path) {
            return Ok(Self(Box::new(RocksDb::open(path)?)));
        }
        refuse_rocksdb(path)?;
        Ok(Self(Box::new(Files::open(path)?)))
    }

    /// Opens a snapshot for reading, even beside a writer or on a read-only disk.
    pub fn open_read_only(path: &Path) -> Result<Self, LedgerError> {
        if !path.exists() {
            // RocksDB would make the folder, as if it held a database, and then fail.
            return Err(LedgerError::NoLedger(path.into()));
        }
        #[cfg(feature = "rocksdb")]
        if is_rocksdb(path) || !on_files::is_in(path) {
            return Ok(Self(Box::new(RocksDb::open_read_only(path)?)));
        }
        refuse_rocksdb(path)?;
        Ok(Self(Box::new(Files::open_read_only(path)?)))
    }

    /// One entry's bytes.
    pub fn entry(&self, index: u64) -> Result<Option<Vec<u8>>, LedgerError> {
        self.get(DatabaseKey::Entry(index))
    }

    /// The signed checkpoint of a size, if one was signed there.
    pub fn checkpoint(&self, size: u64) -> Result<Option<Vec<u8>>, LedgerError> {
        self.get(DatabaseKey::Checkpoint(size))
    }

    /// The first checkpoint of at least `size` entries, and its size.
    pub fn checkpoint_from(&self, size: u64) -> Result<Option<(u64, Vec<u8>)>, LedgerError> {
        let Some(size) = self.0.checkpoint_from(size)? else {
            return Ok(None);
        };
        Ok(self.checkpoint(size)?.map(|text| (size, text)))
    }

    /// The number of entries.
    pub fn size(&self) -> Result<u64, LedgerError> {
        Ok(self.0.size()?)
    }

    /// The RFC 6962 root of the first `size` entries, from the stored hashes.
    pub fn root(&self, size: u64) -> Result<Digest, LedgerError> {
        Ok(Digest(tree_hash(size, self)?.0))
    }

    /// The tree of known size and root, from the stored hashes, which a replay verifies.
    pub fn known_tree(&self, known: &Checkpoint) -> Result<Frontier, LedgerError> {
        let (held, signed) = (self.size()?, known.size);
        if signed == 0 || signed > held {
            return Err(LedgerError::RolledBack { held, signed });
        }
        let tree = Frontier::read(signed, self)?;
        match tree.root()? {
            found if found == known.root => Ok(tree),
            found => Err(LedgerError::Forked {
                size: signed,
                found,
                signed: known.root,
            }),
        }
    }

    /// Every key in order; `None` for a key of an unknown kind.
    pub fn keys(&self) -> impl Iterator<Item = Result<Option<DatabaseKey>, LedgerError>> + '_ {
        self.0.keys().map(|key| Ok(key?))
    }

    /// Writes all of a batch or nothing, durably.
    pub fn commit(&self, batch: StoreBatch) -> Result<(), LedgerError> {
        Ok(self.0.commit(batch.0)?)
    }

    /// The tree's hashes at these stored positions; `None` if one is missing.
    pub fn hashes(&self, positions: &[u64]) -> Result<Option<Vec<Hash>>, LedgerError> {
        let read = |position: &u64| {
            let bytes = self.get(DatabaseKey::Hash(*position))?;
            Ok(bytes.and_then(|bytes| Some(Hash(bytes.try_into().ok()?))))
        };
        positions.iter().map(read).collect()
    }

    fn get(&self, key: DatabaseKey) -> Result<Option<Vec<u8>>, LedgerError> {
        Ok(self.0.get(key)?)
    }
}

impl HashReader for Store {
    fn read_hashes(&self, positions: &[u64]) -> Result<Vec<Hash>, TreeError> {
        let hashes = self.hashes(positions).ok().flatten();
        hashes.ok_or(TreeError::IndexesNotInTree)
    }
}

/// Whether a folder has a RocksDB database, which makes this file last.
fn is_rocksdb(path: &Path) -> bool {
    path.join("CURRENT").exists()
}

fn refuse_rocksdb(path: &Path) -> Result<(), LedgerError> {
    if is_rocksdb(path) {
        Err(LedgerError::NeedsRocksDb(path.into()))
    } else {
        Ok(())
    }
}
