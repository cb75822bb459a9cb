//! A database in three plain append-only files, for a build without RocksDB. It can be read beside a writer.
//!
//! | file | content |
//! |---|---|
//! | `records` | for each entry a [`Record`] in borsh, and its SHA-256 |
//! | `ends` | for each entry, where its record ends: 64 bits, little-endian |
//! | `size` | the number of entries in borsh, and its SHA-256 |
//!
//! A commit appends to the first two files, waits until they are on disk, and then replaces the third. The next one overwrites bytes after
//! the last record, from an interrupted commit.

use super::engine::{DatabaseKey, Engine, Keys};
use crate::error::{io_error, DatabaseError, DatabaseFailure, LedgerError};
use borsh::{BorshDeserialize, BorshSerialize};
use sha2::{Digest as _, Sha256};
use std::fs::{File, TryLockError};
use std::io::{self, ErrorKind};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use tlog_tiles::tlog::{split_stored_hash_index, stored_hash_count, stored_hash_index};
use zk0_files::atomic_file::{self, create_folder};
use zk0_files::bounded_file;

/// The most bytes of a record. An entry and a checkpoint have at most 64 KiB each.
const MAX_RECORD_BYTES: u64 = 1 << 18;

const SEAL: usize = 32;

pub struct Files {
    dir: PathBuf,
    records: File,
    ends: File,
    size: Mutex<u64>,
}

#[derive(BorshSerialize, BorshDeserialize)]
struct Record {
    entry: Vec<u8>,
    /// The tree hashes that become final with it.
    hashes: Vec<Vec<u8>>,
    checkpoint: Option<Vec<u8>>,
}

/// Whether the folder `dir` has such a database, completely made.
pub fn is_in(dir: &Path) -> bool {
    dir.join("size").exists()
}

impl Files {
    /// Opens or makes the database in `dir` for writing.
    pub fn open(dir: &Path) -> Result<Self, LedgerError> {
        create_folder(dir).map_err(io_error(dir))?;
        let mut options = File::options();
        options.read(true).write(true).create(true).truncate(false);
        let open = |name: &str| options.open(dir.join(name)).map_err(io_error(dir));
        let records = open("records")?;
        match records.try_lock() {
            Err(TryLockError::WouldBlock) => return Err(LedgerError::Locked(dir.into())),
            Err(TryLockError::Error(error)) => return Err(io_error(dir)(error)),
            Ok(()) => {}
        }
        let ends = open("ends")?;
        if !is_in(dir) {
            write_size(dir, 0)?;
        }
        Ok(Self::whole(dir, records, ends)?)
    }

    /// Opens a snapshot for reading. Writes nothing.
    pub fn open_read_only(dir: &Path) -> Result<Self, LedgerError> {
        let open = |name: &str| File::open(dir.join(name)).map_err(io_error(dir));
        Ok(Self::whole(dir, open("records")?, open("ends")?)?)
    }

    fn whole(dir: &Path, records: File, ends: File) -> Result<Self, DatabaseError> {
        let text = bounded_file::read(&dir.join("size"), 8 + SEAL as u64).map_err(failed(dir))?;
        let size = unsealed::<u64>(dir, &text)?;
        let held = ends.metadata().map_err(failed(dir))?.len() / 8;
        if size <= held {
            Ok(Self {
                dir: dir.into(),
                records,
                ends,
                size: Mutex::new(size),
            })
        } else {
            Err(damaged(dir, format!("{held} of {size} entries are there")))
        }
    }

    fn locked_size(&self) -> MutexGuard<'_, u64> {
        self.size.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn start(&self, index: u64) -> Result<u64, DatabaseError> {
        let Some(before) = index.checked_sub(1) else {
            return Ok(0);
        };
        let mut end = [0; 8];
        let read = self.ends.read_exact_at(&mut end, before * 8);
        read.map_err(failed(&self.dir))?;
        Ok(u64::from_le_bytes(end))
    }

    fn record(&self, index: u64) -> Result<Option<Record>, DatabaseError> {
        if index >= *self.locked_size() {
            return Ok(None);
        }
        let (start, end) = (self.start(index)?, self.start(index + 1)?);
        let length = end.checked_sub(start);
        let Some(length) = length.filter(|length| *length <= MAX_RECORD_BYTES) else {
            let why = format!("entry {index} lies from {start} to {end}");
            return Err(damaged(&self.dir, why));
        };
        let mut bytes = vec![0; length as usize];
        let read = self.records.read_exact_at(&mut bytes, start);
        read.map_err(failed(&self.dir))?;
        unsealed(&self.dir, &bytes).map(Some)
    }

    fn checkpoints(&self, from: u64) -> impl Iterator<Item = Result<u64, DatabaseError>> + '_ {
        let sizes = from.max(1)..=*self.locked_size();
        sizes.filter_map(|size| match self.get(DatabaseKey::Checkpoint(size)) {
            Ok(text) => text.map(|_| Ok(size)),
            Err(error) => Some(Err(error)),
        })
    }

    fn append(&self, start: u64, size: u64, records: &[Record]) -> io::Result<()> {
        let (mut bytes, mut ends) = (Vec::new(), Vec::new());
        for record in records {
            bytes.extend(sealed(record)?);
            ends.extend((start + bytes.len() as u64).to_le_bytes());
        }
        self.records.write_all_at(&bytes, start)?;
        self.ends.write_all_at(&ends, size * 8)?;
        self.records.sync_data()?;
        self.ends.sync_data()
    }
}

impl Engine for Files {
    fn size(&self) -> Result<u64, DatabaseError> {
        Ok(*self.locked_size())
    }

    fn get(&self, key: DatabaseKey) -> Result<Option<Vec<u8>>, DatabaseError> {
        Ok(match key {
            DatabaseKey::Entry(index) => self.record(index)?.map(|record| record.entry),
            DatabaseKey::Checkpoint(size) => match size.checked_sub(1) {
                Some(index) => self.record(index)?.and_then(|record| record.checkpoint),
                None => None,
            },
            DatabaseKey::Hash(position) if position < stored_hash_count(self.size()?) => {
                let (level, number) = split_stored_hash_index(position);
                // It became final with the last entry below it.
                let record = self.record(((number + 1) << level) - 1)?;
                record.and_then(|record| record.hashes.into_iter().nth(level.into()))
            }
            DatabaseKey::Hash(_) => None,
        })
    }

    fn checkpoint_from(&self, size: u64) -> Result<Option<u64>, DatabaseError> {
        self.checkpoints(size).next().transpose()
    }

    fn keys(&self) -> Keys<'_> {
        let size = *self.locked_size();
        let checkpoints = self
            .checkpoints(1)
            .map(|at| at.map(DatabaseKey::Checkpoint));
        let entries = (0..size).map(|index| Ok(DatabaseKey::Entry(index)));
        let hashes = (0..stored_hash_count(size)).map(|position| Ok(DatabaseKey::Hash(position)));
        let keys = checkpoints.chain(entries).chain(hashes);
        Box::new(keys.map(|key| key.map(Some)))
    }

    fn commit(&self, items: Vec<(DatabaseKey, Vec<u8>)>) -> Result<(), DatabaseError> {
        let mut size = self.locked_size();
        let mut records: Vec<Record> = Vec::new();
        for (key, value) in items {
            let next = *size + records.len() as u64;
            match (key, records.last_mut()) {
                (DatabaseKey::Entry(index), _) if index == next => records.push(Record {
                    entry: value,
                    hashes: Vec::new(),
                    checkpoint: None,
                }),
                (DatabaseKey::Hash(at), Some(last))
                    if at == stored_hash_index(0, next - 1) + last.hashes.len() as u64 =>
                {
                    last.hashes.push(value);
                }
                (DatabaseKey::Checkpoint(size), Some(last)) if size == next => {
                    last.checkpoint = Some(value)
                }
                _ => {
                    let why = format!("{key:?} cannot be appended after {next} entries");
                    return Err(DatabaseError::new(DatabaseFailure::Other, why));
                }
            }
        }
        let start = self.start(*size)?;
        self.append(start, *size, &records)
            .map_err(failed(&self.dir))?;
        let next = *size + records.len() as u64;
        write_size(&self.dir, next)?;
        *size = next;
        Ok(())
    }
}

fn write_size(dir: &Path, size: u64) -> Result<(), DatabaseError> {
    let written = sealed(&size).and_then(|bytes| atomic_file::replace(&dir.join("size"), &bytes));
    written.map_err(failed(dir))
}

/// A value's encoding, and its SHA-256.
fn sealed(value: &impl BorshSerialize) -> io::Result<Vec<u8>> {
    let mut bytes = borsh::to_vec(value)?;
    let seal = Sha256::digest(&bytes);
    bytes.extend(seal);
    Ok(bytes)
}

fn unsealed<T: BorshDeserialize>(dir: &Path, bytes: &[u8]) -> Result<T, DatabaseError> {
    let Some((encoded, seal)) = bytes.split_last_chunk::<SEAL>() else {
        return Err(damaged(dir, "a SHA-256 is missing".into()));
    };
    if Sha256::digest(encoded)[..] != seal[..] {
        return Err(damaged(dir, "a SHA-256 is wrong".into()));
    }
    borsh::from_slice(encoded).map_err(|error| damaged(dir, error.to_string()))
}

fn damaged(dir: &Path, why: String) -> DatabaseError {
    DatabaseError::new(
        DatabaseFailure::Damaged,
        format!("{}: {why}", dir.display()),
    )
}

fn failed(dir: &Path) -> impl Fn(io::Error) -> DatabaseError + '_ {
    |error| {
        let failure = match error.kind() {
            ErrorKind::UnexpectedEof | ErrorKind::FileTooLarge => DatabaseFailure::Damaged,
            _ => DatabaseFailure::OfDisk,
        };
        DatabaseError::new(failure, format!("{}: {error}", dir.display()))
    }
}
