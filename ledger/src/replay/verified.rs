//! The part of a replay that needs earlier entries: tree, checkpoints, rules. Then a fold takes each entry.

use super::chunk::{Chunk, Item, StoredCheckpoint};
use super::stopped::Stopped;
use crate::error::LedgerError;
use crate::group::UNUSED_ROOT;
use crate::store::Store;
use std::path::Path;
use std::sync::Arc;
use zk0_circuits::Digest;
use zk0_protocol::entries::authentic::AuthenticEntry;
use zk0_protocol::entries::entry::needs_checkpoint;
use zk0_protocol::entries::known_keys::KnownKeys;
use zk0_protocol::rules::state::State;
use zk0_protocol::rules::violation::RuleViolation;
use zk0_protocol::tlog::checkpoint::{Checkpoint, KeyedCheckpoint};
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::{Body, Entry, Genesis};

/// Computes something from a history during its verification. The calls come in the order of entries, though from several threads.
pub trait HistoryFold: Send {
    /// Takes the genesis.
    fn genesis(&mut self, _genesis: &Genesis) {}

    /// Takes entry `index`, verified and allowed by the rules in the state `before`.
    fn entry(&mut self, _before: &State, _index: u64, _entry: &Entry) {}

    /// The build of the program, if the fold goes on from a state that this build has kept.
    fn build(&self) -> Option<Digest> {
        None
    }

    /// Goes on from what was kept of this fold after the first `entries` entries, in place of the calls for them.
    ///
    /// # Errors
    /// Why it cannot. The fold is as before.
    fn go_on(&mut self, _kept: &[u8], _entries: u64) -> Result<(), String> {
        Err("nothing goes on from it".into())
    }

    /// Called now and then, with what is verified so far.
    fn pause(&mut self, _verified: &VerifiedHistory) {}
}

impl HistoryFold for () {}

/// The verified first entries of a log.
pub struct VerifiedHistory {
    /// The number of entries in the log.
    whole: u64,
    state: State,
    tree: Frontier,
    /// The verified entries' keys. Threads that verify signatures hold older copies.
    keys: Arc<KnownKeys>,
    checkpoints: u64,
    /// The newest verified checkpoint; empty at the start from an earlier replay.
    checkpoint: Vec<u8>,
}

impl VerifiedHistory {
    /// Verifies the first entry in `store`, the database in `dir`. With `network`, it must found that network.
    pub(super) fn found(
        store: &Store,
        dir: &Path,
        network: Option<&Digest>,
        fold: &mut dyn HistoryFold,
    ) -> Result<Self, Stopped> {
        let Chunk { items, broken } = Chunk::read(store, 0..1, None);
        let Some(item) = items.first() else {
            return Err(broken.unwrap_or_else(|| Stopped::bad(0, "the entry is missing")));
        };
        let state =
            State::found(&item.entry).map_err(|error| Stopped::bad(0, error.to_string()))?;
        check_network(dir, state.network(), network).map_err(|error| Stopped::at(0, error))?;
        let mut history = Self::resume(state, Frontier::default(), 0);
        let (tree, _) = history.with_leaf(item)?;
        history.grow(tree, item.checkpoint.as_ref());
        fold.genesis(history.genesis());
        fold.pause(&history);
        Ok(history)
    }

    /// The state and `tree` of an earlier replay.
    pub(super) fn resume(state: State, tree: Frontier, checkpoints: u64) -> Self {
        Self {
            whole: tree.size(),
            state,
            tree,
            keys: Arc::default(),
            checkpoints,
            checkpoint: Vec::new(),
        }
    }

    /// Sets the log's number of entries. If all are verified, nothing later vouches for the last one, so it needs a checkpoint.
    pub(super) fn is_of(&mut self, store: &Store, whole: u64) -> Result<(), Stopped> {
        self.whole = whole;
        if self.size() < whole {
            return Ok(());
        }
        let index = whole.saturating_sub(1);
        let text = store.checkpoint(whole)?;
        let signed = text.map(|text| StoredCheckpoint::open(text, Some(self.genesis())));
        let after = Checkpoint {
            size: whole,
            root: self.root()?,
        };
        let key = self.state.log_keys().present();
        check_checkpoint(signed.as_ref(), key, &after, true)
            .map_err(|why| Stopped::bad(index, why))?;
        self.checkpoint = signed.map_or_else(Vec::new, |signed| signed.text);
        Ok(())
    }

    /// The number of verified entries.
    pub fn size(&self) -> u64 {
        self.tree.size()
    }

    /// The number of entries in the log, as far as it is known.
    pub fn whole(&self) -> u64 {
        self.whole
    }

    /// The genesis.
    pub fn genesis(&self) -> &Genesis {
        self.state.genesis()
    }

    /// The state after the verified entries.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Their tree's root.
    pub fn root(&self) -> Result<Digest, LedgerError> {
        Ok(self.tree.root()?)
    }

    /// The number of verified checkpoints.
    pub fn checkpoints(&self) -> u64 {
        self.checkpoints
    }

    /// The text of the newest verified checkpoint.
    pub fn checkpoint(&self) -> &[u8] {
        &self.checkpoint
    }

    pub(super) fn keys(&self) -> Arc<KnownKeys> {
        Arc::clone(&self.keys)
    }

    pub(crate) fn into_parts(self) -> (State, Frontier, Vec<u8>) {
        (self.state, self.tree, self.checkpoint)
    }

    /// Verifies the next entries in order. `authentic` has the results of their signatures.
    pub(super) fn take(
        &mut self,
        chunk: &Chunk,
        authentic: &[Result<AuthenticEntry<'_>, RuleViolation>],
        fold: &mut dyn HistoryFold,
    ) -> Result<(), Stopped> {
        for (item, authentic) in chunk.items.iter().zip(authentic) {
            let (tree, root) = self.with_leaf(item)?;
            self.check_allowed(&item.entry, authentic)
                .map_err(|violation| Stopped::bad(item.index, violation.to_string()))?;
            fold.entry(&self.state, item.index, &item.entry);
            self.state.enact(&root, &item.entry);
            // Other threads may hold the map, and a change then copies it.
            if self.keys.lacks(&item.entry) {
                Arc::make_mut(&mut self.keys).learn(&item.entry);
            }
            self.grow(tree, item.checkpoint.as_ref());
        }
        Ok(())
    }

    fn grow(&mut self, tree: Frontier, signed: Option<&StoredCheckpoint>) {
        self.tree = tree;
        if let Some(signed) = signed {
            self.checkpoints += 1;
            self.checkpoint.clone_from(&signed.text);
        }
    }

    /// The tree with one more entry, and its root where something follows from it. Checks the stored hashes that the entry completes, and
    /// its checkpoint.
    fn with_leaf(&self, item: &Item) -> Result<(Frontier, Digest), Stopped> {
        let bad = |why: String| Stopped::bad(item.index, why);
        let mut tree = self.tree.clone();
        let hashes = tree.push_leaf(item.leaf);
        let hashes = hashes.map_err(|error| bad(error.to_string()))?;
        if item.hashes.as_ref() != Some(&hashes) {
            return Err(bad(
                "the stored tree hashes do not belong to the entries".into()
            ));
        }
        let (size, signed) = (tree.size(), item.checkpoint.as_ref());
        let needed = size == self.whole || needs_checkpoint(&item.entry.body);
        if !needed && signed.is_none() {
            return Ok((tree, UNUSED_ROOT));
        }
        let root = tree.root().map_err(|error| bad(error.to_string()))?;
        let key = match &item.entry.body {
            Body::LogKeyRotated { rotation, .. } => &rotation.statement.with.0,
            _ => self.state.log_keys().present(),
        };
        check_checkpoint(signed, key, &Checkpoint { size, root }, needed).map_err(bad)?;
        Ok((tree, root))
    }

    /// Whether the rules allow the entry. Its signatures are verified.
    fn check_allowed(
        &self,
        entry: &Entry,
        authentic: &Result<AuthenticEntry<'_>, RuleViolation>,
    ) -> Result<(), RuleViolation> {
        match authentic {
            Ok(authentic) => self.state.check_authentic(authentic),
            // A wrong version or time is reported first, as when an entry is appended.
            Err(violation) => self.state.check(entry).and(Err(violation.clone())),
        }
    }
}

/// Checks the checkpoint of `after`'s size, which only `needed` requires within a group. `key` is the log's key there.
fn check_checkpoint(
    signed: Option<&StoredCheckpoint>,
    key: &[u8; 32],
    after: &Checkpoint,
    needed: bool,
) -> Result<(), String> {
    match signed.map(|signed| &signed.opened) {
        None if needed => Err("the checkpoint after the entry is missing".into()),
        None => Ok(()),
        Some(Err(why)) => Err(why.clone()),
        Some(Ok(signed)) if signed.checkpoint == *after => signed.check_key(key),
        Some(Ok(KeyedCheckpoint {
            checkpoint: signed, ..
        })) => Err(format!(
            "the checkpoint signs root {} of {} entries, but the first {} entries have root {}",
            signed.root, signed.size, after.size, after.root
        )),
    }
}

/// Refuses a folder of another network.
pub fn check_network(
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
