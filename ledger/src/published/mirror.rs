//! A ledger's folder made from a published log, or brought up to date from it: what an auditor replays, on any machine, long
//! after whoever ran the network is gone. It holds no signing key.
//!
//! Nothing is taken on trust: the checkpoint by its signatures and the policy, every entry by its place in the signed tree,
//! every checkpoint by its signature and root, every blob by its name. What was mirrored before has to be
//! continued: a log that forked or went back is refused, and the folder stays as it is.

use crate::{
    blobs::{BlobError, Blobs},
    error::{io_error, LedgerError},
    folder,
    history::check_network,
    published::{
        reader::{first_entry, PublishedError, PublishedLog},
        source::{Source, SourceError},
    },
    store::{Batch, Store},
};
use std::{fs, io::Read, path::Path};
use tlog_tiles::tlog::{stored_hash_index, HashReader};
use zk0_circuits::Digest;
use zk0_protocol::{
    entries::{
        codec::EntryError,
        entry::{needs_checkpoint, Body, Entry},
        genesis::Genesis,
    },
    rules::{
        named_blobs::{named_blobs, NamedBlob},
        network_rules::Rules,
        required_witnesses::RequiredWitnesses,
        violation::RuleViolation,
    },
    tlog::{
        checkpoint::Checkpoint,
        layout::{Resource, TILE_WIDTH},
        tree::Frontier,
        witness_policy::WitnessPolicy,
    },
};

/// What was mirrored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mirrored {
    /// The network.
    pub network: Digest,
    /// Entries in all.
    pub entries: u64,
    /// Of them, those that were not there before.
    pub new_entries: u64,
    /// Blobs that were fetched.
    pub new_blobs: u64,
    /// Blobs that the ledger names and the log does not serve: not public yet, or not kept.
    pub missing_blobs: u64,
}

/// Why a log is not mirrored.
#[derive(Debug, thiserror::Error)]
pub enum MirrorError {
    /// What is served is not believed.
    #[error(transparent)]
    Published(#[from] PublishedError),
    /// The folder.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// The published checkpoint lacks a quorum.
    #[error("what is published lacks the cosignatures that the network's rules ask for: {0}")]
    Witnesses(String),
    /// The checkpoint after an entry is not what the log signed then.
    #[error("the checkpoint after entry {index}: {why}")]
    Checkpoint { index: u64, why: String },
}

impl From<SourceError> for MirrorError {
    fn from(error: SourceError) -> Self {
        Self::Published(error.into())
    }
}

impl From<EntryError> for MirrorError {
    fn from(error: EntryError) -> Self {
        Self::Ledger(error.into())
    }
}

impl From<BlobError> for MirrorError {
    fn from(error: BlobError) -> Self {
        Self::Ledger(error.into())
    }
}

/// Mirrors the log in `source` to the folder `dir`. If `network` is given it has to be that one; otherwise, the first time,
/// the log is what it says it is. `policy` says whose cosignatures the checkpoint needs; without one, the network's rules do. Those
/// are in the entries: without their quorum the entries, which the log has signed, are kept, and no checkpoint.
pub fn mirror(
    source: &dyn Source,
    dir: &Path,
    policy: Option<&WitnessPolicy>,
    network: Option<&Digest>,
) -> Result<Mirrored, MirrorError> {
    let begun = folder::database(dir).exists();
    let known = match begun {
        true => Store::open_read_only(&folder::database(dir))?.entry(0)?,
        false => None,
    };
    let genesis = genesis(&known.map_or_else(|| first_entry(source), Ok)?)?;
    check_network(dir, &genesis.network_id(), network)?;
    let key = genesis.verifier_key().map_err(PublishedError::from)?;
    let log = PublishedLog::open(source, &key, policy.unwrap_or(&WitnessPolicy::none()))?;
    fs::create_dir_all(dir).map_err(io_error(dir))?;
    let store = Store::open(&folder::database(dir))?;
    let (mut tree, mut asked) = held(&store)?;
    let held = tree.size();
    if let Some(text) = folder::read_checkpoint(dir)? {
        let path = folder::checkpoint(dir);
        let signed = Checkpoint::open(&text, genesis.origin(), &genesis.log_key)
            .map_err(|error| LedgerError::CheckpointFile { path, error })?;
        if signed.size > held {
            let signed = signed.size;
            return Err(LedgerError::RolledBack { held, signed }.into());
        }
    }
    if held > 0 {
        let root = tree.root().map_err(LedgerError::from)?;
        log.continues(&Checkpoint { size: held, root })?;
    }
    extend(&log, &genesis, &store, &mut tree, &mut asked)?;
    let size = tree.size();
    let policy = match policy {
        Some(policy) => policy.clone(),
        None => {
            let asked = asked.policy().map_err(MirrorError::Witnesses)?;
            let opened = asked.open(log.text(), &key);
            opened.map_err(|error| MirrorError::Witnesses(error.to_string()))?;
            asked
        }
    };
    let newest = store.checkpoint(size)?.ok_or(LedgerError::NoEntry(size))?;
    folder::write_checkpoint(dir, &newest)?;
    if policy.wants_witnesses() {
        folder::write_policy(dir, &policy)?;
        folder::write_cosigned(dir, log.text())?;
    }
    let (new_blobs, missing_blobs) = blobs(source, &store, &Blobs::at(dir), &genesis.rules, size)?;
    Ok(Mirrored {
        network: genesis.network_id(),
        entries: size,
        new_entries: size - held,
        new_blobs,
        missing_blobs,
    })
}

/// The genesis in a log's first entry.
pub(crate) fn genesis(bytes: &[u8]) -> Result<Genesis, MirrorError> {
    let broken = |violation: RuleViolation| MirrorError::Ledger(violation.into());
    match Entry::decode(bytes)?.body {
        Body::Genesis(genesis) => {
            let checked = genesis.check();
            checked.map_err(|why| broken(RuleViolation::BadGenesis(why)))?;
            Ok(genesis)
        }
        _ => Err(broken(RuleViolation::NoGenesis)),
    }
}

/// The tree over what a folder holds, its stored hashes checked, and the witnesses that its entries ask for.
fn held(store: &Store) -> Result<(Frontier, RequiredWitnesses), LedgerError> {
    let (mut tree, mut asked) = (Frontier::default(), RequiredWitnesses::default());
    for index in 0..store.size()? {
        let bytes = store.entry(index)?.ok_or(LedgerError::NoEntry(index))?;
        let hashes = tree.push(&bytes)?;
        let positions: Vec<u64> = (stored_hash_index(0, index)..).take(hashes.len()).collect();
        if store.read_hashes(&positions).ok().as_ref() != Some(&hashes) {
            return Err(LedgerError::BadEntry {
                index,
                why: "its tree hashes are missing or wrong".into(),
            });
        }
        asked.observe(&Entry::decode(&bytes)?.body);
    }
    Ok((tree, asked))
}

/// Appends what the log has beyond `tree`.
fn extend(
    log: &PublishedLog<'_>,
    genesis: &Genesis,
    store: &Store,
    tree: &mut Frontier,
    asked: &mut RequiredWitnesses,
) -> Result<(), MirrorError> {
    let size = log.checkpoint().size;
    while tree.size() < size {
        let number = tree.size() / TILE_WIDTH;
        let skip = (tree.size() % TILE_WIDTH) as usize;
        let (entries, checkpoints) = (log.entries(number)?, log.checkpoints(number)?);
        let mut batch = Batch::default();
        for (entry, text) in entries.iter().zip(&checkpoints).skip(skip) {
            let index = tree.size();
            let body = Entry::decode(entry)?.body;
            asked.observe(&body);
            let hashes = tree.push(entry).map_err(LedgerError::from)?;
            batch.entry(index, entry, &hashes);
            let after = Checkpoint {
                size: index + 1,
                root: tree.root().map_err(LedgerError::from)?,
            };
            let wrong = |why: String| MirrorError::Checkpoint { index, why };
            match text {
                Some(text) => {
                    check_checkpoint(text, genesis, &after).map_err(wrong)?;
                    batch.checkpoint(after.size, text);
                }
                None if after.size == size || needs_checkpoint(&body) => {
                    return Err(wrong("it is missing".into()))
                }
                None => {}
            }
        }
        store.commit(batch)?;
    }
    Ok(())
}

/// Whether the log signed what we found.
fn check_checkpoint(text: &[u8], genesis: &Genesis, found: &Checkpoint) -> Result<(), String> {
    let signed = Checkpoint::open(text, genesis.origin(), &genesis.log_key)
        .map_err(|error| error.to_string())?;
    match signed == *found {
        true => Ok(()),
        false => Err(format!(
            "it signs root {} of {} entries, but {} entries have root {}",
            signed.root, signed.size, found.size, found.root
        )),
    }
}

/// Fetches the blobs that the first `size` entries name; returns how many came and how many are not served.
fn blobs(
    source: &dyn Source,
    store: &Store,
    blobs: &Blobs,
    rules: &Rules,
    size: u64,
) -> Result<(u64, u64), MirrorError> {
    let (mut new, mut missing) = (0, 0);
    let mut rules = rules.clone();
    for index in 0..size {
        let bytes = store.entry(index)?.ok_or(LedgerError::NoEntry(index))?;
        let body = Entry::decode(&bytes)?.body;
        if let Body::RoundOpened(opened) = &body {
            rules = opened.rules.clone();
        }
        for NamedBlob { digest, kind } in named_blobs(&body) {
            let limit = kind.max_bytes(&rules);
            if blobs.contains(&digest) {
                continue;
            }
            let path = Resource::Blob(digest).to_string();
            match source.open(&path)? {
                None => missing += 1,
                Some(mut file) => {
                    let mut writer = blobs.writer(limit)?;
                    let mut buffer = vec![0; 64 << 10];
                    loop {
                        let read = file
                            .read(&mut buffer)
                            .map_err(|error| SourceError::new(&path, error.to_string()))?;
                        if read == 0 {
                            break;
                        }
                        writer.write(&buffer[..read])?;
                    }
                    writer.finish(&digest)?;
                    new += 1;
                }
            }
        }
    }
    Ok((new, missing))
}
