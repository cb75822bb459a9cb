//! Mirrors: a ledger's folder made or updated from a published log, without a signing key. An auditor can replay it anywhere, even when the
//! operator is gone.
//!
//! Everything is verified: the newest checkpoint by its signatures and the policy, every entry by its place in the signed tree, every
//! checkpoint by its signature and root, and every copied blob by its digest. If the log does not continue what was mirrored before,
//! because it has forked or is behind, the folder stays as it is.

use crate::blobs::damaged::{CopyError, DamagedBlob};
use crate::blobs::{BlobError, Blobs};
use crate::error::{io_error, LedgerError};
use crate::folder;
use crate::pruned::{self, SignedPruning};
use crate::published::held_entries::HeldEntries;
pub use crate::published::mirror_error::MirrorError;
use crate::published::reader::{first_entry, PublishedError, PublishedLog};
use crate::published::signer;
use crate::published::source::{LogSource, SourceError};
use crate::replay::check_network;
use crate::store::{Store, StoreBatch};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use zk0_circuits::Digest;
use zk0_files::bounded_file;
use zk0_protocol::entries::entry::{needs_checkpoint, Body, Entry};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::log_keys::LogKeys;
use zk0_protocol::pruning::MAX_PRUNING_BYTES;
use zk0_protocol::rules::named_blobs::{named_blobs, NamedBlob};
use zk0_protocol::rules::network_rules::Rules;
use zk0_protocol::rules::required_witnesses::RequiredWitnesses;
use zk0_protocol::rules::violation::RuleViolation;
use zk0_protocol::tlog::checkpoint::{Checkpoint, KeyedCheckpoint, Parsed};
use zk0_protocol::tlog::layout::{Resource, TILE_WIDTH};
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::tlog::witness_policy::WitnessPolicy;

/// The result of mirroring.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mirrored {
    /// The network.
    pub network: Digest,
    /// Entries in the mirror.
    pub entries: u64,
    /// New entries among them.
    pub new_entries: u64,
    /// Fetched blobs.
    pub new_blobs: u64,
    /// Blobs that entries name, but the log does not serve: not public yet, or not kept.
    pub missing_blobs: u64,
    /// Damaged blobs of the mirror that were copied again.
    pub mended_blobs: u64,
    /// Damaged blobs of the source, not copied. A served log causes an error instead.
    pub damaged: Vec<DamagedBlob>,
}

/// The source of a copy's blobs.
pub(crate) enum BlobSource<'a> {
    /// The published log. A blob with a wrong digest ends the copy.
    Served(&'a dyn LogSource),
    /// One's own folder, perhaps with damaged blobs. The copy goes on, to save the others.
    Own {
        blobs: &'a Blobs,
        /// Read each blob of the copy, and replace damaged ones.
        check_copies: bool,
    },
}

enum BlobCopy {
    Done,
    Missing,
    Damaged(DamagedBlob),
}

/// Mirrors the log in `source` to the folder `dir`. The log must be of `network`; without it, the first mirroring accepts any. `policy`, or
/// else the network's rules, name the cosignatures that the checkpoint needs. The rules are in the entries, so these are stored even
/// without a quorum, but the checkpoint is not.
pub fn mirror(
    source: &dyn LogSource,
    dir: &Path,
    policy: Option<&WitnessPolicy>,
    network: Option<&Digest>,
) -> Result<Mirrored, MirrorError> {
    mirror_with(source, &BlobSource::Served(source), dir, policy, network)
}

pub(crate) fn mirror_with(
    source: &dyn LogSource,
    blob_source: &BlobSource<'_>,
    dir: &Path,
    policy: Option<&WitnessPolicy>,
    network: Option<&Digest>,
) -> Result<Mirrored, MirrorError> {
    // A killed import may have left part of a database. This one then makes a new one.
    let begun = Store::is_in(&folder::database(dir));
    let known = if begun {
        Store::open_read_only(&folder::database(dir))?.entry(0)?
    } else {
        None
    };
    let genesis = genesis(&known.map_or_else(|| first_entry(source), Ok)?)?;
    check_network(dir, &genesis.network_id(), network)?;
    // Read before the checkpoint, which then covers it, unless an export is being updated.
    let pruned = served_pruning(source, &genesis)?;
    let key = genesis.verifier_key().map_err(PublishedError::from)?;
    let log = PublishedLog::open(source, &key, policy.unwrap_or(&WitnessPolicy::none()))?;
    fs::create_dir_all(dir).map_err(io_error(dir))?;
    let store = Store::open(&folder::database(dir))?;
    let blobs = Blobs::at(dir);
    // The open database keeps other processes from updating this folder. Unlocked unfinished files are from a killed process.
    blobs.remove_unfinished()?;
    let HeldEntries {
        mut tree,
        mut required,
        mut keys,
    } = HeldEntries::of(&store, &genesis)?;
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
    let shown = log.checkpoint();
    let known = (shown.size <= held).then(|| store.root(shown.size));
    let known = known.transpose()?;
    signer::check(&log, &keys, known == Some(shown.root))?;
    if let Some(known) = known.filter(|known| *known != shown.root) {
        return Err(MirrorError::Published(PublishedError::Forked {
            size: shown.size,
            found: shown.root,
            known,
        }));
    }
    if held > 0 {
        let root = tree.root().map_err(LedgerError::from)?;
        log.continues(&Checkpoint { size: held, root })?;
    }
    extend(
        &log,
        &genesis,
        &store,
        &mut tree,
        (&mut required, &mut keys),
    )?;
    let size = tree.size();
    let named = policy.is_some();
    let policy = match policy {
        Some(policy) => policy.clone(),
        None => {
            let required = required.policy().map_err(MirrorError::Witnesses)?;
            let opened = required.open(log.text(), &key);
            opened.map_err(|error| MirrorError::Witnesses(error.to_string()))?;
            required
        }
    };
    let newest = store.checkpoint(size)?.ok_or(LedgerError::NoEntry(size))?;
    folder::write_checkpoint(dir, &newest)?;
    if policy.wants_witnesses() {
        folder::write_policy(dir, &policy)?;
        folder::write_cosigned(dir, log.text())?;
    } else if !named && has_ruled_policy(dir, &store)? {
        // The rules have dropped the witnesses: their last checkpoint would be published for ever.
        folder::remove_policy(dir)?;
    }
    match (pruned, blob_source) {
        (Some(signed), BlobSource::Served(_)) => {
            // The log's key may have changed since the statement was read.
            let newer = match signed.check_key(&keys, size) {
                Ok(()) => Some(signed),
                Err(_) => served_pruning(source, &genesis)?,
            };
            if let Some(signed) = newer {
                keep_served(dir, (&genesis, &keys), &signed, size)?;
            }
        }
        (Some(signed), BlobSource::Own { .. }) => pruned::keep_newer(dir, &genesis, &signed)?,
        (None, _) => {}
    }
    let mut done = Mirrored {
        network: genesis.network_id(),
        entries: size,
        new_entries: size - held,
        new_blobs: 0,
        missing_blobs: 0,
        mended_blobs: 0,
        damaged: Vec::new(),
    };
    copy_blobs(blob_source, &store, &blobs, &genesis.rules, &mut done)?;
    if let (BlobSource::Served(_), true) = (blob_source, done.missing_blobs > 0) {
        // A running aggregator may have pruned meanwhile.
        if let Some(signed) = served_pruning(source, &genesis)? {
            keep_served(dir, (&genesis, &keys), &signed, size)?;
        }
    }
    Ok(done)
}

/// Keeps a statement about pruned blobs in `dir`, a copy of the log's first `size` entries.
pub(crate) fn keep_pruning(
    dir: &Path,
    genesis: &Genesis,
    signed: &SignedPruning,
    size: u64,
) -> Result<(), MirrorError> {
    let entries = signed.entries();
    if entries > size {
        return Err(MirrorError::BeingUpdated {
            network: genesis.network_id(),
            entries,
            size,
        });
    }
    Ok(pruned::keep_newer(dir, genesis, signed)?)
}

/// [`keep_pruning`] with a statement that somebody serves.
fn keep_served(
    dir: &Path,
    (genesis, keys): (&Genesis, &LogKeys),
    signed: &SignedPruning,
    size: u64,
) -> Result<(), MirrorError> {
    signed.check_key(keys, size)?;
    keep_pruning(dir, genesis, signed, size)
}

fn served_pruning(
    source: &dyn LogSource,
    genesis: &Genesis,
) -> Result<Option<SignedPruning>, MirrorError> {
    let path = Resource::Pruned.to_string();
    let Some(file) = source.open(&path)? else {
        return Ok(None);
    };
    let bytes = bounded_file::read_from(file, MAX_PRUNING_BYTES as u64)
        .map_err(|error| SourceError::new(&path, error.to_string()))?;
    Ok(Some(pruned::decode(&path, &bytes, genesis)?))
}

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

/// Whether the folder's policy comes from the rules at its cosigned checkpoint, and not from the operator.
fn has_ruled_policy(dir: &Path, store: &Store) -> Result<bool, MirrorError> {
    let text = folder::read_cosigned(dir)?;
    let Some(Ok(cosigned)) = text.map(|text| Parsed::read(&text)) else {
        return Ok(false);
    };
    let mut required = RequiredWitnesses::default();
    for index in 0..cosigned.checkpoint.size.min(store.size()?) {
        let bytes = store.entry(index)?.ok_or(LedgerError::NoEntry(index))?;
        required.observe(&Entry::decode(&bytes)?.body);
    }
    let ruled = required.policy().map_err(MirrorError::Witnesses)?;
    Ok(ruled.wants_witnesses() && ruled.text() == folder::read_policy(dir)?.text())
}

fn extend(
    log: &PublishedLog<'_>,
    genesis: &Genesis,
    store: &Store,
    tree: &mut Frontier,
    (required, keys): (&mut RequiredWitnesses, &mut LogKeys),
) -> Result<(), MirrorError> {
    let size = log.checkpoint().size;
    signer::check_given(log, tree.size())?;
    while tree.size() < size {
        let number = tree.size() / TILE_WIDTH;
        let skip = (tree.size() % TILE_WIDTH) as usize;
        let (entries, checkpoints) = (log.entries(number)?, log.checkpoints(number)?);
        let mut batch = StoreBatch::default();
        for (entry, text) in entries.iter().zip(&checkpoints).skip(skip) {
            let index = tree.size();
            let body = Entry::decode(entry)?.body;
            required.observe(&body);
            keys.follow(genesis, index, &body)
                .map_err(|why| LedgerError::BadEntry { index, why })?;
            let hashes = tree.push(entry).map_err(LedgerError::from)?;
            batch.entry(index, entry, &hashes);
            let after = Checkpoint {
                size: index + 1,
                root: tree.root().map_err(LedgerError::from)?,
            };
            let wrong = |why: String| MirrorError::Checkpoint { index, why };
            match text {
                Some(text) => {
                    check_checkpoint(text, genesis, keys.present(), &after).map_err(wrong)?;
                    batch.checkpoint(after.size, text);
                }
                None if after.size == size || needs_checkpoint(&body) => {
                    return Err(wrong("it is missing".into()))
                }
                None => {}
            }
        }
        signer::check_after(log, keys, tree.size())?;
        store.commit(batch)?;
    }
    Ok(())
}

/// Checks that `key` has signed the checkpoint `found`. It is the log's key there.
pub(crate) fn check_checkpoint(
    text: &[u8],
    genesis: &Genesis,
    key: &[u8; 32],
    found: &Checkpoint,
) -> Result<(), String> {
    let signed = KeyedCheckpoint::open(text, genesis.origin(), &genesis.log_key)
        .map_err(|error| error.to_string())?;
    signed.check_key(key)?;
    let signed = signed.checkpoint;
    if signed == *found {
        Ok(())
    } else {
        Err(format!(
            "it signs root {} of {} entries, but the first {} entries have root {}",
            signed.root, signed.size, found.size, found.root
        ))
    }
}

/// Copies the blobs that the entries of the copy name. Adds to `done` what became of them.
pub(crate) fn copy_blobs(
    source: &BlobSource<'_>,
    store: &Store,
    blobs: &Blobs,
    rules: &Rules,
    done: &mut Mirrored,
) -> Result<(), MirrorError> {
    let mut rules = rules.clone();
    // Several entries may name one blob.
    let mut seen = BTreeSet::new();
    for index in 0..done.entries {
        let bytes = store.entry(index)?.ok_or(LedgerError::NoEntry(index))?;
        let body = Entry::decode(&bytes)?.body;
        if let Body::RoundOpened(opened) = &body {
            rules = opened.rules.clone();
        }
        for NamedBlob { digest, kind } in named_blobs(&body) {
            if !seen.insert(digest) {
                continue;
            }
            let damaged = if blobs.contains(&digest) {
                match source.damage_of_copy(blobs, &digest)? {
                    None => continue,
                    damaged => damaged,
                }
            } else {
                None
            };
            match (
                source.copy(blobs, &digest, kind.max_bytes(&rules))?,
                damaged,
            ) {
                (BlobCopy::Done, None) => done.new_blobs += 1,
                (BlobCopy::Done, Some(_)) => done.mended_blobs += 1,
                (BlobCopy::Missing, None) => done.missing_blobs += 1,
                (BlobCopy::Missing, Some(copy)) => done.damaged.push(copy),
                (BlobCopy::Damaged(blob), copy) => {
                    done.damaged.push(blob);
                    done.damaged.extend(copy);
                }
            }
        }
    }
    Ok(())
}

impl BlobSource<'_> {
    fn damage_of_copy(
        &self,
        copies: &Blobs,
        blob: &Digest,
    ) -> Result<Option<DamagedBlob>, BlobError> {
        match self {
            Self::Own {
                check_copies: true, ..
            } => match copies.check(blob) {
                Ok(()) => Ok(None),
                Err(error) => copies.damage(blob, error).map(Some),
            },
            _ => Ok(None),
        }
    }

    /// Copies a blob, of at most `limit` bytes if it is served.
    fn copy(&self, copies: &Blobs, blob: &Digest, limit: u64) -> Result<BlobCopy, MirrorError> {
        match *self {
            Self::Served(source) => copy_served(source, copies, blob, limit),
            Self::Own { blobs, .. } => Ok(copy_own(blobs, copies, blob)?),
        }
    }
}

fn copy_served(
    source: &dyn LogSource,
    copies: &Blobs,
    blob: &Digest,
    limit: u64,
) -> Result<BlobCopy, MirrorError> {
    let path = Resource::Blob(*blob).to_string();
    let Some(mut file) = source.open(&path)? else {
        return Ok(BlobCopy::Missing);
    };
    match copies.copy_from(blob, &mut *file, limit) {
        Ok(()) => Ok(BlobCopy::Done),
        Err(CopyError::Unreadable(error)) => Err(SourceError::new(&path, error.to_string()).into()),
        Err(CopyError::Blob(
            error @ (BlobError::WrongDigest { .. } | BlobError::TooLarge { .. }),
        )) => Err(MirrorError::WrongBlob { path, error }),
        Err(CopyError::Blob(error)) => Err(error.into()),
    }
}

fn copy_own(blobs: &Blobs, copies: &Blobs, blob: &Digest) -> Result<BlobCopy, BlobError> {
    let mut file = match blobs.file_once(blob) {
        Err(BlobError::Missing(_)) => return Ok(BlobCopy::Missing),
        Err(error) => return Ok(BlobCopy::Damaged(blobs.damage(blob, error)?)),
        Ok(file) => file,
    };
    match copies.copy_from(blob, &mut file, u64::MAX) {
        Ok(()) => Ok(BlobCopy::Done),
        Err(CopyError::Unreadable(error)) => Ok(BlobCopy::Damaged(
            blobs.damaged_here(blob, error.to_string()),
        )),
        Err(CopyError::Blob(error)) => Ok(BlobCopy::Damaged(blobs.damage(blob, error)?)),
    }
}
