//! The log on disk: a database with entries, the hashes of their tree, and a signed checkpoint where a group of entries ended
//! ([`crate::group`]). It is RocksDB's, or consists of plain files where a build without RocksDB has made it.

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

/// Entries, hashes and checkpoints that [`Store::commit`] writes at once.
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

    fn put(&mut self, key: DatabaseKey, value: &[u8]) {
        self.0.push((key, value.into()));
    }
}

impl Store {
    /// Whether there is a database in the folder `path`. Where making one was interrupted, there is none yet.
    pub fn is_in(path: &Path) -> bool {
        is_rocksdb(path) || on_files::is_in(path)
    }

    /// Opens a database for writing. Only one process at a time can do so. A new one is RocksDB's where this build has RocksDB.
    pub fn open(path: &Path) -> Result<Self, LedgerError> {
        #[cfg(feature = "rocksdb")]
        if is_rocksdb(path) || !on_files::is_in(path) {
            return Ok(Self(Box::new(RocksDb::open(path)?)));
        }
        refuse_rocksdb(path)?;
        Ok(Self(Box::new(Files::open(path)?)))
    }

    /// Opens a snapshot for reading, while another process may write, or on a read-only file system. This writes nothing.
    pub fn open_read_only(path: &Path) -> Result<Self, LedgerError> {
        if !path.exists() {
            // RocksDB would make the folder, and then fail. What has to be made there would seem to be there.
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

    /// The first checkpoint of `size` entries or more, and its size.
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

    /// The tree of which somebody knows the size and the root, from the stored hashes. A replay verifies that the hashes belong to the entries.
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

    /// Every key in the database, in order; `None` stands for a key of an unknown kind.
    pub fn keys(&self) -> impl Iterator<Item = Result<Option<DatabaseKey>, LedgerError>> + '_ {
        self.0.keys().map(|key| Ok(key?))
    }

    /// Writes all of a batch or nothing. It is on disk when this returns.
    pub fn commit(&self, batch: StoreBatch) -> Result<(), LedgerError> {
        Ok(self.0.commit(batch.0)?)
    }

    /// The tree's hashes at these stored positions; `None` if one of them is missing.
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

/// Whether there is a database of RocksDB in a folder. It makes this file last.
fn is_rocksdb(path: &Path) -> bool {
    path.join("CURRENT").exists()
}

/// Refuses a database of RocksDB. A build that has RocksDB has opened it before.
fn refuse_rocksdb(path: &Path) -> Result<(), LedgerError> {
    if is_rocksdb(path) {
        Err(LedgerError::NeedsRocksDb(path.into()))
    } else {
        Ok(())
    }
}
