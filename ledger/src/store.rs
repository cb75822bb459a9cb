//! The log on disk: a RocksDB database with three kinds of keys.
//!
//! | key | value |
//! |---|---|
//! | `e` ‖ index (big-endian) | an entry's canonical bytes |
//! | `h` ‖ position (big-endian) | a tree hash, at `tlog_tiles::tlog::stored_hash_index` |
//! | `c` ‖ size (big-endian) | the signed checkpoint of the first `size` entries: where a group of entries ended ([`crate::group`]) |

use crate::error::LedgerError;
use rocksdb::{
    BlockBasedOptions, Cache, DBRecoveryMode, Direction, ErrorKind, InfoLogger, IteratorMode,
    LogLevel, Options, WriteBatch, WriteOptions, DB,
};
use std::path::Path;
use tlog_tiles::tlog::{stored_hash_index, tree_hash, Error as TreeError, Hash, HashReader};
use zk0_circuits::Digest;

/// Bytes that RocksDB gathers in memory before it writes a table.
const WRITE_BUFFER: usize = 16 << 20;

/// Bytes of tables that it keeps in memory.
const BLOCK_CACHE: usize = 16 << 20;

/// The database under a ledger.
pub struct Store {
    db: DB,
}

/// Entries, hashes and checkpoints that [`Store::commit`] writes at once.
#[derive(Default)]
pub struct Batch(WriteBatch);

impl Batch {
    /// Entry `index` and the hashes that become final with it ([`zk0_protocol::tlog::tree::Frontier::push`]).
    pub fn entry(&mut self, index: u64, entry: &[u8], hashes: &[Hash]) {
        self.0.put(Key::Entry(index).bytes(), entry);
        for (position, hash) in (stored_hash_index(0, index)..).zip(hashes) {
            self.0.put(Key::Hash(position).bytes(), hash.0);
        }
    }

    /// The signed checkpoint of the first `size` entries.
    pub fn checkpoint(&mut self, size: u64, text: &[u8]) {
        self.0.put(Key::Checkpoint(size).bytes(), text);
    }
}

/// A key of the database, decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// An entry, by index.
    Entry(u64),
    /// A tree hash, by stored position.
    Hash(u64),
    /// A checkpoint, by tree size.
    Checkpoint(u64),
}

impl Key {
    fn bytes(self) -> [u8; 9] {
        let (kind, number) = match self {
            Self::Entry(index) => (b'e', index),
            Self::Hash(position) => (b'h', position),
            Self::Checkpoint(size) => (b'c', size),
        };
        let mut bytes = [kind; 9];
        bytes[1..].copy_from_slice(&number.to_be_bytes());
        bytes
    }

    fn parse(bytes: &[u8]) -> Option<Self> {
        let (kind, number) = bytes.split_first()?;
        let number = u64::from_be_bytes(number.try_into().ok()?);
        match kind {
            b'e' => Some(Self::Entry(number)),
            b'h' => Some(Self::Hash(number)),
            b'c' => Some(Self::Checkpoint(number)),
            _ => None,
        }
    }
}

impl Store {
    /// Opens a database for writing. Only one process at a time can do so.
    pub fn open(path: &Path) -> Result<Self, LedgerError> {
        let mut options = options();
        options.create_if_missing(true);
        match DB::open(&options, path) {
            Ok(db) => Ok(Self { db }),
            Err(error) if is_locked(&error) => Err(LedgerError::Locked(path.into())),
            Err(error) => Err(error.into()),
        }
    }

    /// Opens a snapshot for reading, while another process may write, or on a read-only file system. This writes nothing.
    pub fn open_read_only(path: &Path) -> Result<Self, LedgerError> {
        if !path.exists() {
            // RocksDB would make the folder, and then fail. What has to be made there would seem to be there.
            return Err(LedgerError::NoLedger(path.into()));
        }
        Ok(Self {
            db: DB::open_for_read_only(&options(), path, false)?,
        })
    }

    /// One entry's bytes.
    pub fn entry(&self, index: u64) -> Result<Option<Vec<u8>>, LedgerError> {
        self.get(Key::Entry(index))
    }

    /// The signed checkpoint of a size, if one was signed there.
    pub fn checkpoint(&self, size: u64) -> Result<Option<Vec<u8>>, LedgerError> {
        self.get(Key::Checkpoint(size))
    }

    /// The first checkpoint of `size` entries or more, and its size.
    pub fn checkpoint_from(&self, size: u64) -> Result<Option<(u64, Vec<u8>)>, LedgerError> {
        let start = Key::Checkpoint(size).bytes();
        let mut after = self
            .db
            .iterator(IteratorMode::From(&start, Direction::Forward));
        match after.next().transpose()? {
            Some((key, text)) => Ok(match Key::parse(&key) {
                Some(Key::Checkpoint(size)) => Some((size, text.into_vec())),
                _ => None,
            }),
            None => Ok(None),
        }
    }

    /// The number of entries.
    pub fn size(&self) -> Result<u64, LedgerError> {
        let end = Key::Entry(u64::MAX).bytes();
        match self
            .db
            .iterator(IteratorMode::From(&end, Direction::Reverse))
            .next()
        {
            None => Ok(0),
            Some(found) => match Key::parse(&found?.0) {
                Some(Key::Entry(index)) => Ok(index.saturating_add(1)),
                _ => Ok(0),
            },
        }
    }

    /// The RFC 6962 root of the first `size` entries, from the stored hashes.
    pub fn root(&self, size: u64) -> Result<Digest, LedgerError> {
        Ok(Digest(tree_hash(size, self)?.0))
    }

    /// Every key in the database, in order; `None` stands for a key of an unknown kind.
    pub fn keys(&self) -> impl Iterator<Item = Result<Option<Key>, LedgerError>> + '_ {
        self.db
            .iterator(IteratorMode::Start)
            .map(|found| Ok(Key::parse(&found?.0)))
    }

    /// Writes all of a batch or nothing. It is on disk when this returns.
    pub fn commit(&self, batch: Batch) -> Result<(), LedgerError> {
        let mut durable = WriteOptions::default();
        durable.set_sync(true);
        Ok(self.db.write_opt(batch.0, &durable)?)
    }

    /// The tree's hashes at these stored positions; `None` if one of them is missing.
    pub fn hashes(&self, positions: &[u64]) -> Result<Option<Vec<Hash>>, LedgerError> {
        let read = |position: &u64| {
            let bytes = self.get(Key::Hash(*position))?;
            Ok(bytes.and_then(|bytes| Some(Hash(bytes.try_into().ok()?))))
        };
        positions.iter().map(read).collect()
    }

    fn get(&self, key: Key) -> Result<Option<Vec<u8>>, LedgerError> {
        Ok(self.db.get(key.bytes())?)
    }
}

impl HashReader for Store {
    fn read_hashes(&self, positions: &[u64]) -> Result<Vec<Hash>, TreeError> {
        let hashes = self.hashes(positions).ok().flatten();
        hashes.ok_or(TreeError::IndexesNotInTree)
    }
}

fn options() -> Options {
    let mut options = Options::default();
    options.set_paranoid_checks(true);
    // RocksDB holds the newest data in memory, and reads it from its journal again whenever the database is opened.
    options.set_write_buffer_size(WRITE_BUFFER);
    let mut blocks = BlockBasedOptions::default();
    blocks.set_block_cache(&Cache::new_lru_cache(BLOCK_CACHE));
    options.set_block_based_table_factory(&blocks);
    // A record that a crash cut off is dropped, because it was never acknowledged. If a damaged record looks like one, the log becomes
    // shorter than its signed checkpoint, and opening fails.
    options.set_wal_recovery_mode(DBRecoveryMode::TolerateCorruptedTailRecords);
    // RocksDB's own log messages go to our log, so that the folder holds only data, and read-only file systems can be read.
    options.set_info_logger(InfoLogger::new_callback_logger(
        LogLevel::Warn,
        |_, message| tracing::debug!(target: "rocksdb", "{}", message.trim_end()),
    ));
    options
}

fn is_locked(error: &rocksdb::Error) -> bool {
    let text = error.to_string();
    error.kind() == ErrorKind::IOError
        && (text.contains("lock hold") || text.contains("While lock file"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rocksdb::statistics::Ticker;

    #[test]
    fn a_batch_is_synced_before_commit_returns() {
        let dir = tempfile::tempdir().unwrap();
        let mut options = options();
        options.create_if_missing(true);
        options.enable_statistics();
        let store = Store {
            db: DB::open(&options, dir.path()).unwrap(),
        };
        for index in 0..3 {
            let before = options.get_ticker_count(Ticker::WalFileSynced);
            let mut batch = Batch::default();
            batch.entry(index, b"entry", &[]);
            batch.checkpoint(index + 1, b"checkpoint");
            store.commit(batch).unwrap();
            assert_eq!(options.get_ticker_count(Ticker::WalFileSynced), before + 1);
        }
    }
}
