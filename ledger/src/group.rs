//! Groups: entries that are committed together, on disk with one write and covered by one signed checkpoint.
//!
//! A checkpoint is signed where a group ends. So a log has checkpoints of some sizes and not of others, with exceptions that
//! a reader insists on: the last entry has one, or nothing would vouch for it; and so has an entry whose tree decides
//! something ([`needs_checkpoint`]), since nobody could check what follows from a root that was never signed.

use crate::{error::LedgerError, store::Batch};
use ed25519_dalek::SigningKey;
use rayon::prelude::*;
use tlog_tiles::tlog::{record_hash, Hash};
use zk0_circuits::Digest;
use zk0_protocol::{
    entries::{
        authentic::AuthenticEntry,
        entry::{needs_checkpoint, Entry},
        known_keys::KnownKeys,
    },
    rules::{state::State, violation::RuleViolation},
    tlog::{checkpoint::Checkpoint, tree::Frontier},
};

/// Instead of a root where none is signed: nothing may follow from it, and hashing one for each entry takes as long as all the
/// rest of the tree.
const UNUSED_ROOT: Digest = Digest([0; 32]);

/// A group that the rules allow after what is there, ready to be written.
pub(crate) struct Group {
    /// All that is written.
    pub batch: Batch,
    /// The tree that ends with it.
    pub tree: Frontier,
    /// The root after each entry from which something follows, and after the last.
    pub roots: Vec<Digest>,
    /// The signed checkpoint at its end.
    pub checkpoint: Vec<u8>,
}

/// Makes a group of `entries`, not none, to follow `tree`. Refused if one of them is: `state` says whether the next one may
/// come, and is told of each that may.
pub(crate) fn group(
    entries: &[Entry],
    tree: &Frontier,
    state: &mut Trial<'_>,
    keys: &KnownKeys,
    key: &SigningKey,
) -> Result<Group, LedgerError> {
    let refused = |at: usize, violation: RuleViolation| match entries.len() {
        1 => LedgerError::Rule(violation),
        of => LedgerError::InGroup { at, of, violation },
    };
    let mut group = Group {
        batch: Batch::default(),
        tree: tree.clone(),
        roots: Vec::with_capacity(entries.len()),
        checkpoint: Vec::new(),
    };
    for (at, checked) in check_all(entries, keys).into_iter().enumerate() {
        let (bytes, leaf, entry) = checked.map_err(|violation| refused(at, violation))?;
        let trial = state.check(&entry);
        trial.map_err(|violation| refused(at, violation))?;
        let index = group.tree.size();
        let hashes = group.tree.push_leaf(leaf)?;
        let size = group.tree.size();
        group.batch.entry(index, &bytes, &hashes);
        let mut root = UNUSED_ROOT;
        if needs_checkpoint(&entry.body) || at + 1 == entries.len() {
            root = group.tree.root()?;
            group.checkpoint = Checkpoint { size, root }
                .sign(state.genesis_origin(), key)
                .map_err(|error| LedgerError::Checkpoint { size, error })?;
            group.batch.checkpoint(size, &group.checkpoint);
        }
        state.enact(&root, &entry);
        group.roots.push(root);
    }
    Ok(group)
}

/// An entry's bytes, its leaf, and the entry with its signatures verified.
type Alone<'a> = (Vec<u8>, Hash, AuthenticEntry<'a>);

/// What can be checked of each entry by itself: by all cores, where there are several entries.
fn check_all<'a>(entries: &'a [Entry], keys: &KnownKeys) -> Vec<Result<Alone<'a>, RuleViolation>> {
    let check_alone = |entry: &'a Entry| check_alone(entry, keys);
    match entries.len() {
        1 => entries.iter().map(check_alone).collect(),
        _ => entries
            .par_iter()
            .with_min_len(16)
            .map(check_alone)
            .collect(),
    }
}

fn check_alone<'a>(entry: &'a Entry, keys: &KnownKeys) -> Result<Alone<'a>, RuleViolation> {
    let bytes = entry.encode()?;
    let leaf = record_hash(&bytes);
    Ok((bytes, leaf, entry.authenticate(keys)?))
}

/// The state on which a group is tried: the ledger's own for a single entry, which nothing follows; else a copy, which is
/// taken further while the ledger's stays what it is on disk.
pub(crate) enum Trial<'a> {
    /// Looked at, not changed.
    Single(&'a State),
    /// Changed entry by entry.
    Copy(Box<State>),
}

impl Trial<'_> {
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
