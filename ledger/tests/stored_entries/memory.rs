//! A store in memory, which fails on demand.

use crate::network::log_key;
use ed25519_dalek::SigningKey;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex};
use zk0_circuits::Digest;
use zk0_ledger::blobs::entry_objects::EntryStore;
use zk0_ledger::blobs::error::StoreError;
use zk0_ledger::blobs::store::BlobStore;
use zk0_ledger::blobs::take::Take;
use zk0_ledger::blobs::unverified::SentStore;
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_ledger::stored_entries::decode;
use zk0_ledger::{Ledger, LedgerError};

/// A store in memory, without blobs.
#[derive(Clone, Debug, Default)]
pub struct Memory(Arc<Mutex<Kept>>);

/// What it has.
#[derive(Debug, Default)]
pub struct Kept {
    pub groups: BTreeMap<u64, Vec<u8>>,
    pub pruned: Option<Vec<u8>>,
    /// Whether requests to store that fail.
    pub pruned_fails: bool,
    /// So many requests to store a group fail.
    pub failures: usize,
    /// After which the group is there nevertheless.
    pub late: bool,
    /// Whether it overwrites what it is asked to create.
    pub overwrites: bool,
}

impl Memory {
    /// Opens the ledger in `dir` for writing, with its entries in this store.
    pub fn open(&self, dir: &Path) -> Result<Ledger, LedgerError> {
        self.open_as(dir, log_key())
    }

    pub fn open_as(&self, dir: &Path, key: SigningKey) -> Result<Ledger, LedgerError> {
        let blobs = Blobs::in_store(dir, Box::new(self.clone()))?;
        Ledger::open_with(dir, None, key, blobs, &mut ())
    }

    pub fn change<T>(&self, change: impl FnOnce(&mut Kept) -> T) -> T {
        change(&mut self.0.lock().unwrap())
    }

    pub fn groups(&self) -> BTreeMap<u64, Vec<u8>> {
        self.change(|kept| kept.groups.clone())
    }

    /// All entries of the groups, which have to follow each other.
    pub fn entries(&self) -> Vec<Vec<u8>> {
        let mut all = Vec::new();
        for (first, group) in self.groups() {
            assert_eq!(first, all.len() as u64);
            let entries = decode(&group).unwrap();
            assert!(entries.last().unwrap().checkpoint.is_some());
            all.extend(entries.into_iter().map(|entry| entry.bytes));
        }
        all
    }
}

impl BlobStore for Memory {
    fn address(&self) -> &str {
        "memory"
    }

    fn network(&self) -> Result<Option<Digest>, StoreError> {
        Ok(None)
    }

    fn name_network(&self, network: &Digest) -> Result<Digest, StoreError> {
        Ok(*network)
    }

    fn put(&self, _: &Digest, _: &Path, _: u64) -> Result<(), StoreError> {
        Ok(())
    }

    fn get(&self, blob: &Digest, _: u64, _: Take) -> Result<(), BlobError> {
        Err(BlobError::Missing(*blob))
    }

    fn size(&self, _: &Digest) -> Result<Option<u64>, StoreError> {
        Ok(None)
    }

    fn remove(&self, _: &Digest) -> Result<(), StoreError> {
        Ok(())
    }

    fn all(&self) -> Result<Vec<(Digest, u64)>, StoreError> {
        Ok(Vec::new())
    }

    fn entries(&self) -> &dyn EntryStore {
        self
    }

    fn sent(&self) -> Option<&dyn SentStore> {
        None
    }
}

impl EntryStore for Memory {
    fn place(&self) -> &str {
        "memory"
    }

    fn create_group(&self, first: u64, group: &[u8]) -> Result<bool, StoreError> {
        self.change(|kept| {
            if kept.failures > 0 {
                kept.failures -= 1;
                if kept.late {
                    kept.groups.insert(first, group.to_vec());
                }
                return Err(away());
            }
            if kept.overwrites {
                kept.groups.insert(first, group.to_vec());
                return Ok(true);
            }
            let is_new = !kept.groups.contains_key(&first);
            kept.groups.entry(first).or_insert_with(|| group.to_vec());
            Ok(is_new)
        })
    }

    fn group(&self, first: u64) -> Result<Option<Vec<u8>>, StoreError> {
        Ok(self.change(|kept| kept.groups.get(&first).cloned()))
    }

    fn groups_from(&self, from: u64) -> Result<Vec<u64>, StoreError> {
        Ok(self.change(|kept| kept.groups.range(from..).map(|(first, _)| *first).collect()))
    }

    fn put_pruned(&self, statement: &[u8]) -> Result<(), StoreError> {
        self.change(|kept| {
            if kept.pruned_fails {
                return Err(away());
            }
            kept.pruned = Some(statement.to_vec());
            Ok(())
        })
    }

    fn pruned(&self) -> Result<Option<Vec<u8>>, StoreError> {
        Ok(self.change(|kept| kept.pruned.clone()))
    }
}

fn away() -> StoreError {
    StoreError {
        address: "memory".into(),
        what: "storing".into(),
        why: "away".into(),
    }
}
