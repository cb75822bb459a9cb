//! Groups: entries committed with one write to disk, under one signed checkpoint.
//!
//! So a log has checkpoints of some sizes only. A reader requires one after the last entry, because nothing else vouches for it, and after
//! an entry whose tree determines something ([`needs_checkpoint`]), because an unsigned root proves nothing.

use crate::error::LedgerError;
use crate::store::StoreBatch;
use ed25519_dalek::SigningKey;
use rayon::prelude::*;
use tlog_tiles::tlog::{record_hash, Hash};
use zk0_circuits::Digest;
use zk0_protocol::entries::authentic::{AuthenticBody, AuthenticEntry, DatedBody};
use zk0_protocol::entries::entry::{needs_checkpoint, Entry};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::log_keys::LogKeys;
use zk0_protocol::rules::state::State;
use zk0_protocol::rules::violation::RuleViolation;
use zk0_protocol::tlog::checkpoint::Checkpoint;
use zk0_protocol::tlog::tree::Frontier;

/// The root after an entry without a checkpoint. Nothing follows from it, and computing it would double the tree's cost.
pub(crate) const UNUSED_ROOT: Digest = Digest([0; 32]);

/// An entry to be recorded.
#[derive(Clone, Debug)]
pub struct WantedEntry {
    /// Its time in Unix milliseconds, or that of the entry before it if later.
    pub time_ms: u64,
    /// What it states.
    pub body: AuthenticBody,
}

pub(crate) struct Group {
    pub batch: StoreBatch,
    pub tree: Frontier,
    /// For each entry the root after it, or why the rules refuse it. Roots are true only where something follows from them.
    pub outcomes: Vec<Result<Digest, RuleViolation>>,
    pub checkpoint: Vec<u8>,
}

/// Makes a group after `tree`, of at least one entry. `state` and the allowed entries before it must allow each entry.
///
/// # Errors
/// `key` is not the log's key after an entry that needs a checkpoint.
pub(crate) fn group(
    entries: &[DatedBody],
    tree: &Frontier,
    state: &mut TrialState<'_>,
    key: &SigningKey,
) -> Result<Group, LedgerError> {
    let mut group = Group {
        batch: StoreBatch::default(),
        tree: tree.clone(),
        outcomes: Vec::with_capacity(entries.len()),
        checkpoint: Vec::new(),
    };
    let mut covered = tree.size();
    let mut keys = state.state().log_keys().clone();
    for checked in encode_all(entries) {
        let allowed = checked.and_then(|alone| state.check(&alone.2).map(|()| alone));
        let (bytes, leaf, entry) = match allowed {
            Ok(alone) => alone,
            Err(violation) => {
                group.outcomes.push(Err(violation));
                continue;
            }
        };
        let index = group.tree.size();
        let hashes = group.tree.push_leaf(leaf)?;
        group.batch.entry(index, &bytes, &hashes);
        keys.observe(&entry.body);
        let mut root = UNUSED_ROOT;
        if needs_checkpoint(&entry.body) {
            root = group.sign(state.state().genesis(), &keys, key)?;
            covered = group.tree.size();
        }
        state.enact(&root, &entry);
        group.outcomes.push(Ok(root));
    }
    if covered < group.tree.size() {
        group.sign(state.state().genesis(), &keys, key)?;
    }
    Ok(group)
}

impl Group {
    fn sign(
        &mut self,
        genesis: &Genesis,
        keys: &LogKeys,
        key: &SigningKey,
    ) -> Result<Digest, LedgerError> {
        check_key(genesis, keys, &key.verifying_key().to_bytes())?;
        let (size, root) = (self.tree.size(), self.tree.root()?);
        self.checkpoint = Checkpoint { size, root }
            .sign_after(genesis.origin(), key, keys.rotation())
            .map_err(|error| LedgerError::Checkpoint { size, error })?;
        self.batch.checkpoint(size, &self.checkpoint);
        Ok(root)
    }
}

/// Refuses a key that is not the log's present one.
pub(crate) fn check_key(
    genesis: &Genesis,
    keys: &LogKeys,
    key: &[u8; 32],
) -> Result<(), LedgerError> {
    if keys.present() == key {
        Ok(())
    } else if keys.have(key) {
        Err(LedgerError::FormerKey(genesis.network_id()))
    } else {
        Err(LedgerError::OtherKey(genesis.network_id()))
    }
}

/// An entry's bytes, leaf, and decoded form.
type Alone<'a> = (Vec<u8>, Hash, AuthenticEntry<'a>);

/// Encodes and hashes the entries, on all cores.
fn encode_all(entries: &[DatedBody]) -> Vec<Result<Alone<'_>, RuleViolation>> {
    fn encode(dated: &DatedBody) -> Result<Alone<'_>, RuleViolation> {
        let entry = dated.entry();
        let bytes = entry.encode()?;
        let leaf = record_hash(&bytes);
        Ok((bytes, leaf, entry))
    }
    match entries.len() {
        1 => entries.iter().map(encode).collect(),
        _ => entries.par_iter().with_min_len(16).map(encode).collect(),
    }
}

/// The state that checks a group: for a single entry the ledger's own; for several a copy, while the ledger's state stays as it is on disk.
pub(crate) enum TrialState<'a> {
    Single(&'a State),
    Copy(Box<State>),
}

impl TrialState<'_> {
    fn state(&self) -> &State {
        match self {
            Self::Single(state) => state,
            Self::Copy(state) => state,
        }
    }

    fn check(&self, entry: &AuthenticEntry<'_>) -> Result<(), RuleViolation> {
        self.state().check_authentic(entry)
    }

    fn enact(&mut self, root: &Digest, entry: &Entry) {
        match self {
            Self::Single(_) => {}
            Self::Copy(state) => state.enact(root, entry),
        }
    }
}
