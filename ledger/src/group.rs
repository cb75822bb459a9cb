//! Groups: entries that are committed together, on disk with one write and covered by one signed checkpoint.
//!
//! The log signs a checkpoint at the end of each group, so a log has checkpoints of some sizes and not of others. There are two kinds of
//! entries after which a reader requires a checkpoint: the last entry, because nothing else would vouch for it, and an entry whose
//! tree determines something ([`needs_checkpoint`]), because nobody could verify what follows from a root that was never signed.

use crate::error::LedgerError;
use crate::store::StoreBatch;
use ed25519_dalek::SigningKey;
use rayon::prelude::*;
use tlog_tiles::tlog::{record_hash, Hash};
use zk0_circuits::Digest;
use zk0_protocol::entries::authentic::{AuthenticBody, AuthenticEntry, DatedBody};
use zk0_protocol::entries::entry::{needs_checkpoint, Entry};
use zk0_protocol::rules::state::State;
use zk0_protocol::rules::violation::RuleViolation;
use zk0_protocol::tlog::checkpoint::Checkpoint;
use zk0_protocol::tlog::tree::Frontier;

/// Stands for the root after an entry that has no checkpoint. Nothing follows from such a root, and to compute it for each entry takes as
/// long as all the rest of the tree.
pub(crate) const UNUSED_ROOT: Digest = Digest([0; 32]);

/// An entry that somebody wants to be recorded.
#[derive(Clone, Debug)]
pub struct WantedEntry {
    /// The time that it gets, in Unix milliseconds, or the time of the entry before it if that is later.
    pub time_ms: u64,
    /// What it states.
    pub body: AuthenticBody,
}

/// A group of entries, ready to be written. Entries that the rules refuse are not in it.
pub(crate) struct Group {
    /// Everything that is written to the database.
    pub batch: StoreBatch,
    /// The tree after the group.
    pub tree: Frontier,
    /// For each entry the root after it, or why the rules refuse it. The root is the true one after entries from whose tree something
    /// follows.
    pub outcomes: Vec<Result<Digest, RuleViolation>>,
    /// The signed checkpoint at the end of the group.
    pub checkpoint: Vec<u8>,
}

/// Makes a group of at least one entry that follows `tree`. Each entry has to be allowed by `state` and the entries before it that are
/// allowed.
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
        let mut root = UNUSED_ROOT;
        if needs_checkpoint(&entry.body) {
            root = group.sign(state.genesis_origin(), key)?;
            covered = group.tree.size();
        }
        state.enact(&root, &entry);
        group.outcomes.push(Ok(root));
    }
    if covered < group.tree.size() {
        group.sign(state.genesis_origin(), key)?;
    }
    Ok(group)
}

impl Group {
    /// Signs a checkpoint of the tree so far, and returns its root.
    fn sign(&mut self, origin: &str, key: &SigningKey) -> Result<Digest, LedgerError> {
        let (size, root) = (self.tree.size(), self.tree.root()?);
        self.checkpoint = Checkpoint { size, root }
            .sign(origin, key)
            .map_err(|error| LedgerError::Checkpoint { size, error })?;
        self.batch.checkpoint(size, &self.checkpoint);
        Ok(root)
    }
}

/// An entry's bytes, its leaf, and the entry.
type Alone<'a> = (Vec<u8>, Hash, AuthenticEntry<'a>);

/// Encodes and hashes the entries, on all cores if there are several.
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

/// The state that checks a group. For a single entry it is the ledger's own state. For several entries it is a copy, to which they are
/// applied one after the other, while the ledger's state stays as it is on disk.
pub(crate) enum TrialState<'a> {
    /// The ledger's state, which is not changed.
    Single(&'a State),
    /// A copy, which is changed entry by entry.
    Copy(Box<State>),
}

impl TrialState<'_> {
    fn state(&self) -> &State {
        match self {
            Self::Single(state) => state,
            Self::Copy(state) => state,
        }
    }

    fn genesis_origin(&self) -> &str {
        self.state().genesis().origin()
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
