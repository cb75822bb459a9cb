//! The history in a database. Before a writer signs more, it reads all entries, applies the rules, and compares the result with what the
//! log has signed.

use crate::error::LedgerError;
use crate::folder;
use crate::store::Store;
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;
use tlog_tiles::tlog::{record_hash, stored_hash_index, Hash};
use zk0_circuits::Digest;
use zk0_protocol::entries::authentic::AuthenticEntry;
use zk0_protocol::entries::entry::needs_checkpoint;
use zk0_protocol::entries::known_keys::KnownKeys;
use zk0_protocol::rules::state::State;
use zk0_protocol::rules::violation::RuleViolation;
use zk0_protocol::tlog::checkpoint::Checkpoint;
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::{Entry, Genesis};

/// How many entries are read at once; all cores verify their signatures. An entry has at most 64 KiB.
const CHUNK: u64 = 512;

/// A history that continues the newest published checkpoint.
pub(crate) struct ContinuedHistory {
    pub state: State,
    pub tree: Frontier,
    /// The newest checkpoint in the database. It is the published one, or a newer one.
    pub checkpoint: Vec<u8>,
}

impl ContinuedHistory {
    /// Reads and verifies everything: each entry by the rules, each tree hash, each checkpoint, and the root at the size of `published`, which
    /// is the content of the checkpoint file.
    pub fn read(
        store: &Store,
        dir: &Path,
        network: Option<&Digest>,
        published: Option<&[u8]>,
    ) -> Result<Self, LedgerError> {
        let held = store.size()?;
        if held == 0 {
            return Err(LedgerError::NoLedger(dir.into()));
        }
        let mut tree = Frontier::default();
        let mut keys = KnownKeys::default();
        let mut state = found(store)?;
        check_network(dir, state.network(), network)?;
        let signed = open_published(dir, &state, held, published)?;
        let mut newest = None;
        for start in (0..held).step_by(CHUNK as usize) {
            let indexes = start..held.min(start + CHUNK);
            let chunk = chunk(store, state.genesis(), indexes)?;
            let authentic = authenticate(&chunk, &keys);
            for (read, authentic) in chunk.iter().zip(authentic) {
                let index = tree.size();
                let refused = |error: RuleViolation| bad(index, error.to_string());
                let hashes = tree.push_leaf(read.leaf)?;
                let positions: Vec<u64> =
                    (stored_hash_index(0, index)..).take(hashes.len()).collect();
                if store.hashes(&positions)?.as_ref() != Some(&hashes) {
                    return Err(bad(index, "its tree hashes are missing or wrong".into()));
                }
                let root = tree.root()?;
                if index > 0 {
                    let entry = authentic.map_err(refused)?;
                    state.check_authentic(&entry).map_err(refused)?;
                    state.enact(&root, &entry);
                    keys.learn(&entry);
                }
                match &read.checkpoint {
                    Some((_, checkpoint)) => same_root(checkpoint, root)?,
                    None if needs_checkpoint(&read.entry.body) || index + 1 == held => {
                        return Err(bad(index, "the checkpoint after it is missing".into()))
                    }
                    None => {}
                }
                match signed {
                    Some(signed) if signed.size == index + 1 => same_root(&signed, root)?,
                    _ => {}
                }
            }
            newest = chunk
                .into_iter()
                .next_back()
                .and_then(|read| read.checkpoint);
        }
        let (checkpoint, _) = newest.ok_or(LedgerError::NoCheckpointAt(held))?;
        Ok(Self {
            state,
            tree,
            checkpoint,
        })
    }
}

fn bad(index: u64, why: String) -> LedgerError {
    LedgerError::BadEntry { index, why }
}

/// The state after the first entry.
fn found(store: &Store) -> Result<State, LedgerError> {
    let bytes = store.entry(0)?;
    let bytes = bytes.ok_or_else(|| bad(0, "it is missing".into()))?;
    let entry = Entry::decode(&bytes).map_err(|error| bad(0, error.to_string()))?;
    State::found(&entry).map_err(|error| bad(0, error.to_string()))
}

/// A stored entry, with the text and the content of the checkpoint after it, if there is one.
struct StoredEntry {
    leaf: Hash,
    entry: Entry,
    checkpoint: Option<(Vec<u8>, Checkpoint)>,
}

impl StoredEntry {
    fn of(
        index: u64,
        bytes: &[u8],
        text: Option<Vec<u8>>,
        genesis: &Genesis,
    ) -> Result<Self, LedgerError> {
        let checkpoint = match text {
            Some(text) => {
                let opened = Checkpoint::open(&text, genesis.origin(), &genesis.log_key);
                let size = index + 1;
                let checkpoint = opened.map_err(|error| LedgerError::Checkpoint { size, error })?;
                if checkpoint.size != size {
                    let why = format!("the checkpoint after it is of {} entries", checkpoint.size);
                    return Err(bad(index, why));
                }
                Some((text, checkpoint))
            }
            None => None,
        };
        Ok(Self {
            leaf: record_hash(bytes),
            entry: Entry::decode(bytes).map_err(|error| bad(index, error.to_string()))?,
            checkpoint,
        })
    }
}

/// Reads entries, and verifies the signatures of checkpoints.
fn chunk(
    store: &Store,
    genesis: &Genesis,
    indexes: Range<u64>,
) -> Result<Vec<StoredEntry>, LedgerError> {
    let mut stored = Vec::new();
    for index in indexes {
        let bytes = store.entry(index)?;
        let bytes = bytes.ok_or_else(|| bad(index, "it is missing".into()))?;
        stored.push((index, bytes, store.checkpoint(index + 1)?));
    }
    let read: Vec<Result<StoredEntry, LedgerError>> = stored
        .into_par_iter()
        .map(|(index, bytes, text)| StoredEntry::of(index, &bytes, text, genesis))
        .collect();
    // The order is kept, so that the first of several faults is named.
    read.into_iter().collect()
}

fn authenticate<'a>(
    chunk: &'a [StoredEntry],
    keys: &KnownKeys,
) -> Vec<Result<AuthenticEntry<'a>, RuleViolation>> {
    chunk
        .par_iter()
        .map(|read| read.entry.authenticate(keys))
        .collect()
}

fn open_published(
    dir: &Path,
    founded: &State,
    held: u64,
    published: Option<&[u8]>,
) -> Result<Option<Checkpoint>, LedgerError> {
    let path = folder::checkpoint(dir);
    let genesis = founded.genesis();
    match published {
        // The writer was killed right after the founding.
        None if held == 1 => Ok(None),
        None => Err(LedgerError::NoCheckpoint(path)),
        Some(text) => {
            let signed = Checkpoint::open(text, genesis.origin(), &genesis.log_key)
                .map_err(|error| LedgerError::CheckpointFile { path, error })?;
            match signed.size {
                size if size > held || size == 0 => {
                    Err(LedgerError::RolledBack { held, signed: size })
                }
                _ => Ok(Some(signed)),
            }
        }
    }
}

fn same_root(signed: &Checkpoint, found: Digest) -> Result<(), LedgerError> {
    if signed.root == found {
        Ok(())
    } else {
        Err(LedgerError::Forked {
            size: signed.size,
            found,
            signed: signed.root,
        })
    }
}

/// Refuses a folder of another network than `expected`.
pub(crate) fn check_network(
    dir: &Path,
    found: &Digest,
    expected: Option<&Digest>,
) -> Result<(), LedgerError> {
    match expected {
        Some(expected) if expected != found => Err(LedgerError::OtherNetwork {
            dir: dir.into(),
            found: *found,
            expected: *expected,
        }),
        _ => Ok(()),
    }
}
