//! A published log from a database with any leaves, at any size, and a source of its files that can lie.

use super::*;
use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use zk0_ledger::published::source::{Source, SourceError};
use zk0_ledger::published::tiles;
use zk0_ledger::store::{Batch, Store};
use zk0_protocol::tlog::layout::Resource;
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::Checkpoint;

#[allow(unused_imports)] // Not every test uses both.
pub use super::log::{log_vkey, ORIGIN};

/// A database with these leaves.
pub struct Shelf {
    _dir: tempfile::TempDir,
    pub store: Store,
}

impl Shelf {
    pub fn of(leaves: &[Vec<u8>]) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path()).unwrap();
        let mut tree = Frontier::default();
        for (index, leaf) in leaves.iter().enumerate() {
            let hashes = tree.push(leaf).unwrap();
            let root = tree.root().unwrap();
            let size = index as u64 + 1;
            let text = Checkpoint { size, root }.sign(ORIGIN, &log_key()).unwrap();
            let mut batch = Batch::default();
            batch.entry(index as u64, leaf, &hashes);
            batch.checkpoint(size, &text);
            store.commit(batch).unwrap();
        }
        Self { _dir: dir, store }
    }

    pub fn checkpoint(&self, size: u64) -> Checkpoint {
        let root = self.store.root(size).unwrap();
        Checkpoint { size, root }
    }

    /// Returns what a log publishes of the first `size` leaves.
    pub fn at(&self, size: u64) -> Shown<'_> {
        Shown {
            store: &self.store,
            size,
            instead: BTreeMap::new(),
        }
    }
}

/// The log at one size; `instead` replaces files, or hides them.
pub struct Shown<'a> {
    pub store: &'a Store,
    pub size: u64,
    pub instead: BTreeMap<String, Option<Vec<u8>>>,
}

impl Source for Shown<'_> {
    fn open(&self, path: &str) -> Result<Option<Box<dyn Read>>, SourceError> {
        if let Some(instead) = self.instead.get(path) {
            let bytes = instead.clone();
            return Ok(bytes.map(|bytes| Box::new(Cursor::new(bytes)) as Box<dyn Read>));
        }
        let bytes = match Resource::parse(path) {
            Some(Resource::Checkpoint) => self.store.checkpoint(self.size).unwrap(),
            Some(Resource::Tile(tile)) => tiles::read(self.store, self.size, &tile).unwrap(),
            _ => None,
        };
        Ok(bytes.map(|bytes| Box::new(Cursor::new(bytes)) as Box<dyn Read>))
    }
}
