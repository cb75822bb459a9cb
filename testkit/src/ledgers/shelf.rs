//! A published log of any leaves and size, whose files can lie.

use crate::network::log::ORIGIN;
use crate::network::log_key;
use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use zk0_ledger::published::source::{LogSource, SourceError};
use zk0_ledger::published::tiles;
use zk0_ledger::store::{Store, StoreBatch};
use zk0_protocol::tlog::layout::Resource;
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::Checkpoint;

/// A database of leaves.
pub struct Shelf {
    _dir: tempfile::TempDir,
    /// The database.
    pub store: Store,
}

impl Shelf {
    /// Has a checkpoint of each size.
    pub fn of(leaves: &[Vec<u8>]) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path()).unwrap();
        let mut tree = Frontier::default();
        for (index, leaf) in leaves.iter().enumerate() {
            let hashes = tree.push(leaf).unwrap();
            let root = tree.root().unwrap();
            let size = index as u64 + 1;
            let text = Checkpoint { size, root }.sign(ORIGIN, &log_key()).unwrap();
            let mut batch = StoreBatch::default();
            batch.entry(index as u64, leaf, &hashes);
            batch.checkpoint(size, &text);
            store.commit(batch).unwrap();
        }
        Self { _dir: dir, store }
    }

    /// The checkpoint of `size` leaves.
    pub fn checkpoint(&self, size: u64) -> Checkpoint {
        let root = self.store.root(size).unwrap();
        Checkpoint { size, root }
    }

    /// The log of the first `size` leaves.
    pub fn at(&self, size: u64) -> ShownLog<'_> {
        ShownLog {
            store: &self.store,
            size,
            instead: BTreeMap::new(),
        }
    }
}

/// The log at one size.
pub struct ShownLog<'a> {
    /// The whole log's database.
    pub store: &'a Store,
    /// Number of leaves.
    pub size: u64,
    /// Replaced files; `None` hides one.
    pub instead: BTreeMap<String, Option<Vec<u8>>>,
}

impl LogSource for ShownLog<'_> {
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
