//! A ledger's database in RocksDB. It can be read beside a writer.
//!
//! | key | value |
//! |---|---|
//! | `e` ‖ index (big-endian) | an entry's canonical bytes |
//! | `h` ‖ position (big-endian) | a tree hash, at `tlog_tiles::tlog::stored_hash_index` |
//! | `c` ‖ size (big-endian) | the signed checkpoint of the first `size` entries |

use super::engine::{DatabaseKey, Engine, Keys};
use crate::error::{DatabaseError, DatabaseFailure, LedgerError};
use rocksdb::{
    BlockBasedOptions, Cache, DBRecoveryMode, Direction, ErrorKind, InfoLogger, IteratorMode,
    LogLevel, Options, WriteBatch, WriteOptions, DB,
};
use std::path::Path;

/// Bytes that RocksDB gathers in memory before it writes a table.
const WRITE_BUFFER: usize = 16 << 20;

/// Bytes of tables that it keeps in memory.
const BLOCK_CACHE: usize = 16 << 20;

pub struct RocksDb(DB);

impl RocksDb {
    /// Opens or makes the database in `path` for writing.
    pub fn open(path: &Path) -> Result<Self, LedgerError> {
        let mut options = options();
        options.create_if_missing(true);
        match DB::open(&options, path) {
            Ok(db) => Ok(Self(db)),
            Err(error) if is_locked(&error) => Err(LedgerError::Locked(path.into())),
            Err(error) => Err(LedgerError::Database(error.into())),
        }
    }

    /// Opens a snapshot for reading. Writes nothing.
    pub fn open_read_only(path: &Path) -> Result<Self, LedgerError> {
        let opened = DB::open_for_read_only(&options(), path, false);
        Ok(Self(opened.map_err(DatabaseError::from)?))
    }

    fn first(&self, mode: IteratorMode<'_>) -> Result<Option<DatabaseKey>, DatabaseError> {
        let item = self.0.iterator(mode).next().transpose()?;
        Ok(item.and_then(|(key, _)| parse(&key)))
    }
}

impl Engine for RocksDb {
    fn size(&self) -> Result<u64, DatabaseError> {
        let end = bytes(DatabaseKey::Entry(u64::MAX));
        Ok(
            match self.first(IteratorMode::From(&end, Direction::Reverse))? {
                Some(DatabaseKey::Entry(index)) => index.saturating_add(1),
                _ => 0,
            },
        )
    }

    fn get(&self, key: DatabaseKey) -> Result<Option<Vec<u8>>, DatabaseError> {
        Ok(self.0.get(bytes(key))?)
    }

    fn checkpoint_from(&self, size: u64) -> Result<Option<u64>, DatabaseError> {
        let start = bytes(DatabaseKey::Checkpoint(size));
        Ok(
            match self.first(IteratorMode::From(&start, Direction::Forward))? {
                Some(DatabaseKey::Checkpoint(size)) => Some(size),
                _ => None,
            },
        )
    }

    fn keys(&self) -> Keys<'_> {
        let items = self.0.iterator(IteratorMode::Start);
        Box::new(items.map(|item| Ok(parse(&item?.0))))
    }

    fn commit(&self, items: Vec<(DatabaseKey, Vec<u8>)>) -> Result<(), DatabaseError> {
        let mut batch = WriteBatch::default();
        for (key, value) in items {
            batch.put(bytes(key), value);
        }
        let mut durable = WriteOptions::default();
        durable.set_sync(true);
        Ok(self.0.write_opt(batch, &durable)?)
    }
}

fn bytes(key: DatabaseKey) -> [u8; 9] {
    let (kind, number) = match key {
        DatabaseKey::Entry(index) => (b'e', index),
        DatabaseKey::Hash(position) => (b'h', position),
        DatabaseKey::Checkpoint(size) => (b'c', size),
    };
    let mut bytes = [kind; 9];
    bytes[1..].copy_from_slice(&number.to_be_bytes());
    bytes
}

fn parse(bytes: &[u8]) -> Option<DatabaseKey> {
    let (kind, number) = bytes.split_first()?;
    let number = u64::from_be_bytes(number.try_into().ok()?);
    match kind {
        b'e' => Some(DatabaseKey::Entry(number)),
        b'h' => Some(DatabaseKey::Hash(number)),
        b'c' => Some(DatabaseKey::Checkpoint(number)),
        _ => None,
    }
}

pub(super) fn options() -> Options {
    let mut options = Options::default();
    options.set_paranoid_checks(true);
    // RocksDB holds the newest data in memory, and replays its journal at each opening.
    options.set_write_buffer_size(WRITE_BUFFER);
    let mut blocks = BlockBasedOptions::default();
    blocks.set_block_cache(&Cache::new_lru_cache(BLOCK_CACHE));
    options.set_block_based_table_factory(&blocks);
    // A record that a crash cut off was never acknowledged, and is dropped. If a damaged record looks like one, the log becomes shorter
    // than its signed checkpoint, and opening fails.
    options.set_wal_recovery_mode(DBRecoveryMode::TolerateCorruptedTailRecords);
    // Our log takes RocksDB's messages, so that the folder holds only data, and can be read-only.
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

impl From<rocksdb::Error> for DatabaseError {
    fn from(error: rocksdb::Error) -> Self {
        let failure = match error.kind() {
            ErrorKind::IOError => DatabaseFailure::OfDisk,
            ErrorKind::Corruption | ErrorKind::InvalidArgument => DatabaseFailure::Damaged,
            _ => DatabaseFailure::Other,
        };
        Self::new(failure, error)
    }
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
        let database = RocksDb(DB::open(&options, dir.path()).unwrap());
        for index in 0..3 {
            let before = options.get_ticker_count(Ticker::WalFileSynced);
            let checkpoint = (DatabaseKey::Checkpoint(index + 1), b"checkpoint".to_vec());
            let items = vec![(DatabaseKey::Entry(index), b"entry".to_vec()), checkpoint];
            database.commit(items).unwrap();
            assert_eq!(options.get_ticker_count(Ticker::WalFileSynced), before + 1);
        }
    }
}
