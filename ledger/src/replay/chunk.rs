//! The part of a replay that needs only one entry: reading, decoding, verifying signatures. Several threads do it.

use super::stopped::Stopped;
use crate::store::Store;
use std::ops::Range;
use tlog_tiles::tlog::{record_hash, stored_hash_index, Hash};
use zk0_protocol::entries::authentic::AuthenticEntry;
use zk0_protocol::entries::known_keys::KnownKeys;
use zk0_protocol::rules::violation::RuleViolation;
use zk0_protocol::tlog::checkpoint::KeyedCheckpoint;
use zk0_protocol::{Body, Entry, Genesis};

/// The most entries in a chunk.
pub const CHUNK: u64 = 256;

/// Consecutive entries, read and decoded.
pub struct Chunk {
    /// The entries before the first unreadable one.
    pub items: Vec<Item>,
    /// Why that one is unreadable.
    pub broken: Option<Stopped>,
}

/// An entry and what is stored beside it.
pub struct Item {
    pub index: u64,
    pub entry: Entry,
    /// Its leaf hash in the tree.
    pub leaf: Hash,
    /// The stored hashes that became final with it; `None` if one is missing.
    pub hashes: Option<Vec<Hash>>,
    /// The checkpoint after it, if any.
    pub checkpoint: Option<StoredCheckpoint>,
}

pub struct StoredCheckpoint {
    pub text: Vec<u8>,
    /// The checkpoint and its key, if the signature is valid; otherwise why not.
    pub opened: Result<KeyedCheckpoint, String>,
}

impl Chunk {
    /// Reads the entries in `range` of `genesis`' log. Without it, the first entry must be a genesis.
    pub fn read(store: &Store, range: Range<u64>, genesis: Option<&Genesis>) -> Self {
        let mut items = Vec::new();
        for index in range {
            match Item::read(store, index, genesis) {
                Ok(item) => items.push(item),
                Err(broken) => {
                    let broken = Some(broken);
                    return Self { items, broken };
                }
            }
        }
        Self {
            items,
            broken: None,
        }
    }

    /// Verifies each entry's signatures, and new keys.
    pub fn authenticate(&self, keys: &KnownKeys) -> Vec<Result<AuthenticEntry<'_>, RuleViolation>> {
        self.items
            .iter()
            .map(|item| item.entry.authenticate(keys))
            .collect()
    }
}

impl Item {
    fn read(store: &Store, index: u64, genesis: Option<&Genesis>) -> Result<Self, Stopped> {
        let stops = |error| Stopped::at(index, error);
        let bytes = store.entry(index).map_err(stops)?;
        let bytes = bytes.ok_or_else(|| Stopped::bad(index, "the entry is missing"))?;
        let entry = Entry::decode(&bytes);
        let entry = entry.map_err(|error| Stopped::bad(index, error.to_string()))?;
        let completed = (index + 1).trailing_zeros() as usize + 1;
        let positions: Vec<u64> = (stored_hash_index(0, index)..).take(completed).collect();
        let hashes = store.hashes(&positions).map_err(stops)?;
        let text = store.checkpoint(index + 1).map_err(stops)?;
        let genesis = match &entry.body {
            Body::Genesis(own) => genesis.or(Some(own)),
            _ => genesis,
        };
        let checkpoint = text.map(|text| StoredCheckpoint::open(text, genesis));
        Ok(Self {
            index,
            leaf: record_hash(&bytes),
            hashes,
            checkpoint,
            entry,
        })
    }
}

impl StoredCheckpoint {
    /// Verifies the signature by the log of `genesis`.
    pub fn open(text: Vec<u8>, genesis: Option<&Genesis>) -> Self {
        let opened = match genesis {
            Some(genesis) => KeyedCheckpoint::open(&text, genesis.origin(), &genesis.log_key)
                .map_err(|error| error.to_string()),
            None => Err("no genesis names the key that signs checkpoints".into()),
        };
        Self { text, opened }
    }
}
