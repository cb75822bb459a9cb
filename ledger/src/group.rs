//! Groups: entries that are committed together, on disk with one write and covered by one signed checkpoint.
//!
//! The log signs a checkpoint at the end of each group, so a log has checkpoints of some sizes and not of others. There are two kinds of
//! entries after which a reader requires a checkpoint: the last entry, because nothing else would vouch for it, and an entry whose
//! tree determines something ([`needs_checkpoint`]), because nobody could verify what follows from a root that was never signed.

use crate::error::LedgerError;
use crate::store::Batch;
use ed25519_dalek::SigningKey;
use rayon::prelude::*;
use tlog_tiles::tlog::{record_hash, Hash};
use zk0_circuits::Digest;
use zk0_protocol::entries::authentic::{AuthenticEntry, AuthenticSubmission};
use zk0_protocol::entries::entry::{needs_checkpoint, Entry};
use zk0_protocol::entries::known_keys::KnownKeys;
use zk0_protocol::rules::state::State;
use zk0_protocol::rules::violation::RuleViolation;
use zk0_protocol::tlog::checkpoint::Checkpoint;
use zk0_protocol::tlog::tree::Frontier;

/// Stands for the root after an entry that has no checkpoint. Nothing follows from such a root, and to compute it for each entry takes as
/// long as all the rest of the tree.
const UNUSED_ROOT: Digest = Digest([0; 32]);

/// A group of entries that the rules allow, ready to be written.
pub(crate) struct Group {
    /// Everything that is written to the database.
    pub batch: Batch,
    /// The tree after the group.
    pub tree: Frontier,
    /// The root after each entry: the true one after entries from whose tree something follows and after the last entry.
    pub roots: Vec<Digest>,
    /// The signed checkpoint at the end of the group.
    pub checkpoint: Vec<u8>,
}

/// Makes a group of at least one entry that follows `tree`. The signature of the submission `known` is not verified again. If `state` refuses one of the entries, the whole group is refused.
pub(crate) fn group(
    entries: &[Entry],
    tree: &Frontier,
    state: &mut Trial<'_>,
    keys: &KnownKeys,
    key: &SigningKey,
    known: Option<&AuthenticSubmission>,
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
    for (at, checked) in check_all(entries, keys, known).into_iter().enumerate() {
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

/// Makes the checks that need only the entry itself, on all cores if there are several entries.
fn check_all<'a>(
    entries: &'a [Entry],
    keys: &KnownKeys,
    known: Option<&AuthenticSubmission>,
) -> Vec<Result<Alone<'a>, RuleViolation>> {
    let check_alone = |entry: &'a Entry| {
        let bytes = entry.encode()?;
        let leaf = record_hash(&bytes);
        let authentic = known.and_then(|submission| submission.decided_by(entry));
        let authentic = authentic.map_or_else(|| entry.authenticate(keys), Ok)?;
        Ok((bytes, leaf, authentic))
    };
    match entries.len() {
        1 => entries.iter().map(check_alone).collect(),
        _ => entries
            .par_iter()
            .with_min_len(16)
            .map(check_alone)
            .collect(),
    }
}

/// The state that checks a group. For a single entry it is the ledger's own state. For several entries it is a copy, to which they are
/// applied one after the other, while the ledger's state stays as it is on disk.
pub(crate) enum Trial<'a> {
    /// The ledger's state, which is not changed.
    Single(&'a State),
    /// A copy, which is changed entry by entry.
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
