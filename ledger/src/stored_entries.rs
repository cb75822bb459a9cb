//! The log's entries in the store of its blobs ([`crate::blobs::entry_objects`]).
//!
//! The order makes them safe, and fences writers off from each other:
//! 1. A group is signed in memory.
//! 2. It becomes an object in the store. If another group is there, another aggregator writes this log, and the signature is thrown away.
//! 3. It is written to disk.
//! 4. What depends on it leaves: receipts, checkpoints, answers.
//!
//! A writer killed after step 2 leaves a group only in the store. It was never acknowledged. The next start takes it ([`reconcile`]).

use crate::blobs::entry_objects::{group_name, EntryStore, FOLDER};
use crate::blobs::error::BlobError;
use crate::error::{io_error, LedgerError};
use crate::folder;
use crate::group::check_key;
use crate::published::mirror::check_checkpoint;
use crate::store::{DatabaseKey, Store, StoreBatch};
use borsh::{BorshDeserialize, BorshSerialize};
use std::panic::resume_unwind;
use std::path::Path;
use std::thread;
use zk0_files::atomic_file::{create_folder, folder_of};
use zk0_protocol::entries::entry::{needs_checkpoint, Entry};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::log_keys::LogKeys;
use zk0_protocol::rules::state::State;
use zk0_protocol::tlog::checkpoint::{Checkpoint, KeyedCheckpoint};
use zk0_protocol::tlog::tree::Frontier;

const VERSION: u8 = 1;

/// A group made of entries on disk ends at the first checkpoint after so many.
const LARGE_GROUP: usize = 1024;

/// It also ends at the first one after so many bytes.
const LARGE_GROUP_BYTES: usize = 8 << 20;

/// The store is asked for the groups of so many entries before the last one on disk. If it has none of these, for all.
const RECENT: u64 = 4096;

/// How many groups are read at once.
const AT_ONCE: usize = 32;

/// An entry in the store.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct StoredEntry {
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// The checkpoint after it, if one was signed there.
    pub checkpoint: Option<Vec<u8>>,
}

/// What the object of these entries holds.
pub fn encode(entries: &[StoredEntry]) -> Vec<u8> {
    borsh::to_vec(&(VERSION, entries)).expect("writing to a Vec cannot fail")
}

/// The entries of an object.
///
/// # Errors
/// Why it holds none.
pub fn decode(object: &[u8]) -> Result<Vec<StoredEntry>, String> {
    match object.split_first() {
        Some((&VERSION, entries)) => {
            borsh::from_slice(entries).map_err(|error| format!("it holds no entries ({error})"))
        }
        Some((version, _)) => Err(format!("it is of version {version}, not {VERSION}")),
        None => Err("it is empty".into()),
    }
}

/// The object of a group that is about to be written to disk.
pub(crate) fn encode_batch(batch: &StoreBatch) -> Vec<u8> {
    let mut entries: Vec<StoredEntry> = Vec::new();
    for (key, value) in batch.items() {
        match key {
            DatabaseKey::Entry(_) => entries.push(StoredEntry {
                bytes: value.clone(),
                checkpoint: None,
            }),
            DatabaseKey::Checkpoint(_) => {
                if let Some(last) = entries.last_mut() {
                    last.checkpoint = Some(value.clone());
                }
            }
            DatabaseKey::Hash(_) => {}
        }
    }
    encode(&entries)
}

/// Stores the group that begins with entry `first`, unless this very group is there.
///
/// # Errors
/// Another group is there ([`LedgerError::OtherEntries`]), or the store does not answer.
pub(crate) fn put(store: &dyn EntryStore, first: u64, group: &[u8]) -> Result<(), LedgerError> {
    let created = store.create_group(first, group).map_err(BlobError::from)?;
    // An earlier try may have come through without an answer.
    let is_there = created || get(store, first)?.as_deref() == Some(group);
    if is_there {
        Ok(())
    } else {
        Err(other_entries(store, first))
    }
}

/// Founds the ledger in `dir`, which has none, from the first entry in the store, whose log has `log_key`, if given. The next opening takes
/// the entries after it.
pub(crate) fn found(
    dir: &Path,
    log_key: Option<&[u8; 32]>,
    store: &dyn EntryStore,
) -> Result<(), LedgerError> {
    let Some(object) = get(store, 0)? else {
        let later = store.groups_from(0).map_err(BlobError::from)?;
        if later.is_empty() {
            return Err(LedgerError::NoEntries {
                dir: dir.into(),
                address: store.place().into(),
            });
        }
        return Err(missing(store, 0));
    };
    let bad = |why: String| bad(store, 0, why);
    let first = decode(&object).map_err(bad)?.into_iter().next();
    let Some(StoredEntry {
        bytes,
        checkpoint: Some(text),
    }) = first
    else {
        return Err(bad(
            "it does not begin with a genesis and its checkpoint".into()
        ));
    };
    let entry = Entry::decode(&bytes).map_err(|error| bad(error.to_string()))?;
    let state = State::found(&entry).map_err(|error| bad(error.to_string()))?;
    let mut tree = Frontier::default();
    let hashes = tree.push(&bytes)?;
    let (size, root) = (tree.size(), tree.root()?);
    let founding = &state.genesis().log_key;
    check_checkpoint(&text, state.genesis(), founding, &Checkpoint { size, root }).map_err(bad)?;
    if let Some(log_key) = log_key {
        if newest_key(store, state.genesis())? != *log_key {
            return Err(not_of(log_key, store, state.genesis()));
        }
    }
    create_folder(dir).map_err(io_error(dir))?;
    let database = Store::open(&folder::database(dir))?;
    folder::sync(dir)?;
    folder::sync(folder_of(dir))?;
    let mut batch = StoreBatch::default();
    batch.entry(0, &bytes, &hashes);
    batch.checkpoint(size, &text);
    database.commit(batch)?;
    folder::write_checkpoint(dir, &text)
}

/// The key that signed the newest checkpoint in the store. Only the entries tell whether it is the log's.
fn newest_key(store: &dyn EntryStore, genesis: &Genesis) -> Result<[u8; 32], LedgerError> {
    let groups = store.groups_from(0).map_err(BlobError::from)?;
    let first = groups.into_iter().max().unwrap_or(0);
    let object = get(store, first)?.ok_or_else(|| missing(store, first))?;
    let bad = |why: String| bad(store, first, why);
    let newest = decode(&object).map_err(bad)?.pop();
    let Some(text) = newest.and_then(|newest| newest.checkpoint) else {
        return Err(bad("it does not end with a checkpoint".into()));
    };
    let signed = KeyedCheckpoint::open(&text, genesis.origin(), &genesis.log_key);
    let signed = signed.map_err(|error| bad(error.to_string()))?;
    let network = signed.check_network(&genesis.network_id());
    network.map_err(|error| bad(error.to_string()))?;
    Ok(signed.key)
}

/// Why the newest checkpoint in the store is not one of this key: as the entries there show, it is not the log's, or no more, or somebody
/// has signed with a former key.
fn not_of(log_key: &[u8; 32], store: &dyn EntryStore, genesis: &Genesis) -> LedgerError {
    match keys_in(store, genesis) {
        Err(error) => error,
        Ok((keys, newest)) => match check_key(genesis, &keys, log_key) {
            Err(LedgerError::OtherKey(network)) => LedgerError::EntriesOfOther {
                address: store.place().into(),
                network,
            },
            Err(error) => error,
            Ok(()) => {
                let why =
                    "a key that is not the log's present one has signed it, and may be stolen";
                bad(store, newest, why.into())
            }
        },
    }
}

/// The log's keys after all entries in the store, and its newest group.
fn keys_in(store: &dyn EntryStore, genesis: &Genesis) -> Result<(LogKeys, u64), LedgerError> {
    let mut groups = store.groups_from(0).map_err(BlobError::from)?;
    groups.sort_unstable();
    let (mut keys, mut newest) = (LogKeys::of(genesis), 0);
    for first in groups {
        let bad = |why: String| bad(store, first, why);
        let object = get(store, first)?.ok_or_else(|| missing(store, first))?;
        for (index, stored) in (first..).zip(decode(&object).map_err(bad)?) {
            let entry = Entry::decode(&stored.bytes).map_err(|error| bad(error.to_string()))?;
            keys.follow(genesis, index, &entry.body).map_err(bad)?;
        }
        newest = first;
    }
    Ok((keys, newest))
}

/// Brings the database in `dir` and the store to the same entries: takes those that the store has more, or puts there those that it lacks.
/// The database's are verified, and determine the keys. Returns whether it has new entries, verified by their checkpoints, not by the rules.
pub(crate) fn reconcile(
    dir: &Path,
    database: &Store,
    known: (&Genesis, &LogKeys),
    store: &dyn EntryStore,
) -> Result<bool, LedgerError> {
    let held = database.size()?;
    let groups = groups_around(store, held)?;
    let stored = match groups.first() {
        None => 0,
        Some(first) if *first > held => return Err(missing(store, 0)),
        Some(first) => {
            let tree = tree_of(database, *first)?;
            take(dir, database, known, (store, &groups[..]), tree)?
        }
    };
    if stored < held {
        put_rest(database, store, stored..held)?;
    }
    check_fence(store)?;
    Ok(stored > held)
}

/// Checks that the store refuses to create what it has: that fences aggregators off from each other. Not every service that speaks S3 knows
/// `If-None-Match`.
fn check_fence(store: &dyn EntryStore) -> Result<(), LedgerError> {
    let first = get(store, 0)?.ok_or_else(|| missing(store, 0))?;
    if store.create_group(0, &first).map_err(BlobError::from)? {
        return Err(LedgerError::NoFence(store.place().into()));
    }
    Ok(())
}

/// The groups from the last that begins with entry `held` or earlier, in order. Without such a group, all.
fn groups_around(store: &dyn EntryStore, held: u64) -> Result<Vec<u64>, LedgerError> {
    let mut from = held.saturating_sub(RECENT);
    loop {
        let mut groups = store.groups_from(from).map_err(BlobError::from)?;
        groups.sort_unstable();
        let earlier = groups.partition_point(|first| *first <= held);
        if earlier > 0 || from == 0 {
            return Ok(groups.split_off(earlier.saturating_sub(1)));
        }
        from = 0;
    }
}

fn tree_of(database: &Store, size: u64) -> Result<Frontier, LedgerError> {
    if size == 0 {
        return Ok(Frontier::default());
    }
    let root = database.root(size)?;
    database.known_tree(&Checkpoint { size, root })
}

/// Compares the groups with the database, and adds what it lacks. `tree` ends where the first group begins. Returns how many entries the
/// store has.
fn take(
    dir: &Path,
    database: &Store,
    (genesis, keys): (&Genesis, &LogKeys),
    (store, groups): (&dyn EntryStore, &[u64]),
    mut tree: Frontier,
) -> Result<u64, LedgerError> {
    let held = database.size()?;
    let mut keys = keys.clone();
    for some in groups.chunks(AT_ONCE) {
        let (mut batch, mut newest) = (StoreBatch::default(), None);
        for (first, object) in some.iter().zip(read(store, some)?) {
            if *first > tree.size() {
                return Err(missing(store, tree.size()));
            }
            let bad = |why: String| bad(store, *first, why);
            if *first < tree.size() {
                return Err(bad("it begins before the group before it ends".into()));
            }
            let mut other = None;
            let mut covered = tree.size();
            for StoredEntry { bytes, checkpoint } in decode(&object).map_err(bad)? {
                let index = tree.size();
                let hashes = tree.push(&bytes)?;
                let (size, root) = (tree.size(), tree.root()?);
                let decoded = || Entry::decode(&bytes).map_err(|error| bad(error.to_string()));
                if index >= held {
                    keys.follow(genesis, index, &decoded()?.body).map_err(bad)?;
                    batch.entry(index, &bytes, &hashes);
                } else if database.entry(index)?.as_ref() != Some(&bytes) {
                    other = other.or(Some(index));
                }
                if let Some(text) = checkpoint {
                    let key = keys.at(size);
                    check_checkpoint(&text, genesis, key, &Checkpoint { size, root })
                        .map_err(bad)?;
                    covered = size;
                    if size > held {
                        batch.checkpoint(size, &text);
                        newest = Some(text);
                    }
                } else if needs_checkpoint(&decoded()?.body) {
                    return Err(bad(format!(
                        "the checkpoint after entry {index} is missing"
                    )));
                }
            }
            if covered < tree.size() || covered == *first {
                return Err(bad("it does not end with a checkpoint".into()));
            }
            // The log has signed both.
            if let Some(index) = other {
                return Err(other_entries(store, index));
            }
        }
        if let Some(newest) = newest {
            database.commit(batch)?;
            folder::write_checkpoint(dir, &newest)?;
        }
    }
    let stored = tree.size();
    if stored > held {
        tracing::info!(
            "{} entries were taken from the blob store {}",
            stored - held,
            store.place()
        );
    }
    Ok(stored)
}

/// Puts these entries of the database into the store, in large groups.
fn put_rest(
    database: &Store,
    store: &dyn EntryStore,
    entries: std::ops::Range<u64>,
) -> Result<(), LedgerError> {
    let (mut first, end, count) = (entries.start, entries.end, entries.end - entries.start);
    let (mut group, mut size) = (Vec::new(), 0);
    for index in entries {
        let bytes = database.entry(index)?.ok_or(LedgerError::NoEntry(index))?;
        let checkpoint = database.checkpoint(index + 1)?;
        let may_end = checkpoint.is_some();
        size += bytes.len();
        group.push(StoredEntry { bytes, checkpoint });
        let is_large = group.len() >= LARGE_GROUP || size >= LARGE_GROUP_BYTES;
        if may_end && (is_large || index + 1 == end) {
            put(store, first, &encode(&group))?;
            first = index + 1;
            size = 0;
            group.clear();
        }
    }
    tracing::info!(
        "{count} entries were put into the blob store {}",
        store.place()
    );
    Ok(())
}

fn read(store: &dyn EntryStore, groups: &[u64]) -> Result<Vec<Vec<u8>>, LedgerError> {
    thread::scope(|scope| {
        let reading: Vec<_> = groups
            .iter()
            .map(|first| scope.spawn(move || get(store, *first)))
            .collect();
        let read = reading.into_iter().zip(groups).map(|(reading, first)| {
            let object = reading
                .join()
                .unwrap_or_else(|panic| resume_unwind(panic))?;
            object.ok_or_else(|| missing(store, *first))
        });
        read.collect()
    })
}

fn get(store: &dyn EntryStore, first: u64) -> Result<Option<Vec<u8>>, LedgerError> {
    Ok(store.group(first).map_err(BlobError::from)?)
}

fn object(first: u64) -> String {
    format!("{FOLDER}/{}", group_name(first))
}

fn other_entries(store: &dyn EntryStore, index: u64) -> LedgerError {
    LedgerError::OtherEntries {
        address: store.place().into(),
        index,
    }
}

fn missing(store: &dyn EntryStore, first: u64) -> LedgerError {
    LedgerError::MissingEntries {
        address: store.place().into(),
        object: object(first),
    }
}

fn bad(store: &dyn EntryStore, first: u64, why: String) -> LedgerError {
    LedgerError::BadEntries {
        address: store.place().into(),
        object: object(first),
        why,
    }
}
