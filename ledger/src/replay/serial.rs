//! The part of a replay that needs the entries before: the tree, the rules, the caller's checks. It takes one entry after the other.

use super::chunk::{Chunk, Item};
use super::saved::Saving;
use super::{
    Finding, Recheck, ReplayOptions, ReplayReport, SaveOptions, SavedReplay, Severity, Verdict,
};
use crate::blobs::Blobs;
use crate::error::LedgerError;
use crate::history::check_network;
use crate::pruned;
use crate::store::Store;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use zk0_circuits::Digest;
use zk0_protocol::entries::authentic::AuthenticEntry;
use zk0_protocol::entries::entry::needs_checkpoint;
use zk0_protocol::entries::known_keys::KnownKeys;
use zk0_protocol::rules::state::State;
use zk0_protocol::rules::violation::RuleViolation;
use zk0_protocol::tlog::checkpoint::Checkpoint;
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::{Body, Entry, Genesis};

/// The history that is verified so far.
pub struct Serial<'a> {
    dir: PathBuf,
    network: Option<Digest>,
    recheck: &'a mut dyn Recheck,
    from: Option<SavedReplay>,
    known: Option<SavedReplay>,
    seen: Option<Checkpoint>,
    keep: Option<SaveOptions>,
    kept: Instant,
    /// Why the newest write to the file of `keep` failed.
    unsaved: Option<String>,
    blobs: Blobs,
    /// Entries in the database.
    size: u64,
    /// The tree. It may be one entry ahead of what is verified.
    tree: Frontier,
    /// How many entries are verified, and their root.
    verified: Option<(u64, Digest)>,
    state: Option<State>,
    /// The keys that the verified entries use. Threads that verify signatures hold older copies.
    keys: Arc<KnownKeys>,
    checkpoints: u64,
    findings: Vec<Finding>,
    /// How many entries an earlier replay verified. It may have had the same findings about them.
    before: u64,
    /// How many entries the file of `keep` is about, if this replay does not go on from it. It stays as it is until as many are verified.
    known_size: u64,
}

impl<'a> Serial<'a> {
    pub fn new(dir: &Path, options: ReplayOptions<'_>, recheck: &'a mut dyn Recheck) -> Self {
        Self {
            dir: dir.into(),
            network: options.network,
            recheck,
            from: options.from,
            known: options.known,
            seen: options.seen,
            keep: options.keep,
            kept: Instant::now(),
            unsaved: None,
            blobs: Blobs::at(dir),
            size: 0,
            tree: Frontier::default(),
            verified: None,
            state: None,
            keys: Arc::default(),
            checkpoints: 0,
            findings: Vec::new(),
            before: 0,
            known_size: 0,
        }
    }

    /// Begins with the earlier replay, or with the genesis, of a log of `size` entries. Returns the index of the next entry.
    pub fn begin(&mut self, store: &Store, size: u64) -> Result<u64, Finding> {
        self.size = size;
        self.recheck.begin(size);
        if let Some(seen) = self.seen {
            self.check_root(store, &seen)?;
        }
        if let Some(known) = self.known.take() {
            self.check_continues(store, &known)?;
            self.known_size = known.size;
        }
        let next = match self.from.take() {
            Some(saved) => self.resume(store, saved)?,
            None => {
                let chunk = Chunk::read(store, 0..1, None);
                let authentic = chunk.authenticate(&self.keys);
                self.take(&chunk, &authentic)?;
                1
            }
        };
        self.read_pruning()?;
        Ok(next)
    }

    /// Reads what the log's operator says about blobs that are no longer kept. It cannot be about more entries than the log has.
    fn read_pruning(&mut self) -> Result<(), Finding> {
        let Some(genesis) = self.state.as_ref().map(State::genesis) else {
            return Ok(());
        };
        let stops = |error: LedgerError| Finding::of_error(None, &error);
        match pruned::read(&self.dir, genesis).map_err(stops)? {
            Some(pruning) if pruning.entries > self.size => Err(Finding::fault(
                None,
                format!(
                    "ROLLED BACK: the log's operator has signed a statement about pruned blobs and {} entries, but there are {}",
                    pruning.entries, self.size
                ),
            )),
            Some(pruning) => {
                self.recheck.pruned(&pruning);
                Ok(())
            }
            None => Ok(()),
        }
    }

    /// Checks that the log continues an earlier replay: it must have the same root at that size. Returns that root, and the tree.
    fn check_continues(
        &self,
        store: &Store,
        saved: &SavedReplay,
    ) -> Result<(Digest, Frontier), Finding> {
        let fault = |text: String| Finding::fault(None, text);
        let founder = Chunk::read(store, 0..1, None);
        if let Some(broken) = founder.broken {
            return Err(broken);
        }
        let found = match founder.items.first().map(|item| &item.entry.body) {
            Some(Body::Genesis(genesis)) => genesis.network_id(),
            _ => return Err(Finding::fault(0, "the first entry is not a genesis")),
        };
        if found != *saved.network() {
            return Err(fault(format!(
                "the earlier audit is of network {}, but this is network {found}: name another state file",
                saved.network()
            )));
        }
        check_network(&self.dir, &found, self.network.as_ref())
            .map_err(|error| fault(error.to_string()))?;
        let (size, root) = (saved.size, saved.root);
        let tree = self.check_root(store, &Checkpoint { size, root })?;
        Ok((root, tree))
    }

    /// Checks that the log has the root that an earlier audit verified at that size. Returns the tree of that size.
    fn check_root(&self, store: &Store, saved: &Checkpoint) -> Result<Frontier, Finding> {
        let fault = |text: String| Finding::fault(None, text);
        if saved.size > self.size {
            return Err(fault(format!(
                "ROLLED BACK: an earlier audit verified {} entries, but now there are {}",
                saved.size, self.size
            )));
        }
        let tree = Frontier::read(saved.size, store).and_then(|tree| Ok((tree.root()?, tree)));
        let (root, tree) = tree.map_err(|error| {
            fault(format!(
                "the tree of the {} entries that an earlier audit verified cannot be read: {error}",
                saved.size
            ))
        })?;
        if root != saved.root {
            return Err(fault(format!(
                "FORKED: the first {} entries have root {root}, but an earlier audit verified root {}",
                saved.size, saved.root
            )));
        }
        Ok(tree)
    }

    /// Goes on from an earlier replay.
    fn resume(&mut self, store: &Store, saved: SavedReplay) -> Result<u64, Finding> {
        let (root, tree) = self.check_continues(store, &saved)?;
        // Without new entries, no later checkpoint vouches for the last one, so it needs its own.
        if saved.size == self.size {
            let signed = store.checkpoint(saved.size);
            let signed = signed.map_err(|error| Finding::of_error(None, &error))?;
            let genesis = saved.state.genesis();
            let signed = signed.map(|text| {
                Checkpoint::open(&text, genesis.origin(), &genesis.log_key)
                    .map_err(|error| error.to_string())
            });
            let after = Checkpoint {
                size: saved.size,
                root,
            };
            check_checkpoint(signed.as_ref(), &after, true)
                .map_err(|why| Finding::fault(saved.size.saturating_sub(1), why))?;
        }
        self.tree = tree;
        self.verified = Some((saved.size, root));
        self.state = Some(saved.state);
        self.checkpoints = saved.checkpoints;
        self.findings = saved.findings;
        self.before = saved.size;
        Ok(saved.size)
    }

    pub fn genesis(&self) -> Option<&Genesis> {
        self.state.as_ref().map(State::genesis)
    }

    /// The keys that are known so far, for the threads that verify signatures.
    pub fn keys(&self) -> Arc<KnownKeys> {
        Arc::clone(&self.keys)
    }

    /// Verifies the next entries, in order.
    pub fn take(
        &mut self,
        chunk: &Chunk,
        authentic: &[Result<AuthenticEntry<'_>, RuleViolation>],
    ) -> Result<(), Finding> {
        for (item, authentic) in chunk.items.iter().zip(authentic) {
            self.step(item, authentic)
                .map_err(|why| Finding::fault(item.index, why))?;
        }
        if let Some(broken) = &chunk.broken {
            return Err(broken.clone());
        }
        let size = self.verified.map_or(0, |(size, _)| size);
        let due = |keep: &SaveOptions| size >= self.known_size && self.kept.elapsed() >= keep.every;
        if self.keep.as_ref().is_some_and(due) {
            self.save();
        }
        Ok(())
    }

    /// Verifies one entry: its hashes, the checkpoint after it, the rules, and the caller's own checks.
    fn step(
        &mut self,
        item: &Item,
        authentic: &Result<AuthenticEntry<'_>, RuleViolation>,
    ) -> Result<(), String> {
        let text = |error: LedgerError| error.to_string();
        let entry = &item.entry;
        let hashes = self
            .tree
            .push_leaf(item.leaf)
            .map_err(|error| error.to_string())?;
        if item.hashes.as_ref() != Some(&hashes) {
            return Err("the stored tree hashes do not belong to the entries".into());
        }
        let root = self.tree.root().map_err(|error| error.to_string())?;
        let size = item.index + 1;
        let after = Checkpoint { size, root };
        let needed = size == self.size || needs_checkpoint(&entry.body);
        let signed = item.checkpoint.as_ref();
        match &mut self.state {
            None => {
                let founded = State::found(entry).map_err(|error| error.to_string())?;
                check_network(&self.dir, founded.network(), self.network.as_ref()).map_err(text)?;
                check_checkpoint(signed, &after, needed)?;
                let found = self.recheck.genesis(founded.genesis(), &self.blobs);
                self.state = Some(founded);
                self.found(found);
            }
            Some(state) => {
                check_checkpoint(signed, &after, needed)?;
                allowed(state, entry, authentic).map_err(|error| error.to_string())?;
                let found = self.recheck.entry(state, item.index, entry, &self.blobs);
                state.enact(&root, entry);
                // The map is copied when other threads hold it, so it is left alone where nothing is new.
                if self.keys.lacks(entry) {
                    Arc::make_mut(&mut self.keys).learn(entry);
                }
                self.found(found);
            }
        }
        self.checkpoints += u64::from(signed.is_some());
        self.verified = Some((size, root));
        Ok(())
    }

    fn found(&mut self, findings: Vec<Finding>) {
        for finding in findings {
            let again = finding.index.is_some_and(|index| index < self.before);
            if !(again && self.findings.contains(&finding)) {
                self.findings.push(finding);
            }
        }
    }

    /// Saves what is verified so far.
    fn save(&mut self) {
        let found = self.recheck.settle();
        self.found(found);
        if !self.recheck.may_be_saved() {
            self.kept = Instant::now();
            return;
        }
        let (Some(keep), Some(verified), Some(state)) = (&self.keep, self.verified, &self.state)
        else {
            return;
        };
        let saving = Saving {
            verified,
            checkpoints: self.checkpoints,
            state,
            findings: &self.findings,
            recheck: self.recheck.save(),
        };
        // A later write may succeed, when the disk has room again. The last one decides what the next replay knows.
        let written = saving.write(&keep.path);
        self.unsaved = written.err().map(|error| error.to_string());
        self.kept = Instant::now();
    }

    /// Ends the replay. If it stopped early, `stopped` says why, and nothing more is saved.
    pub fn report(mut self, stopped: Option<Finding>) -> ReplayReport {
        match stopped {
            None => self.save(),
            Some(_) => {
                let found = self.recheck.settle();
                self.found(found);
            }
        }
        let mut findings = self.findings;
        findings.extend(self.recheck.summary());
        findings.extend(self.unsaved.as_ref().map(|why| {
            let text = "the state of this audit cannot be saved, so the next audit does not know what this one has verified";
            Finding::note(None, format!("{text}: {why}"))
        }));
        // A replay stops at a fault, or where it cannot read any further.
        let unread = stopped
            .as_ref()
            .filter(|why| why.severity != Severity::Fault);
        let unread = unread.cloned();
        findings.extend(stopped);
        let worst = findings.iter().map(|finding| finding.severity).max();
        ReplayReport {
            verdict: match worst {
                _ if self.state.is_none() && unread.is_none() => Verdict::Failed,
                Some(Severity::Fault) => Verdict::Failed,
                Some(Severity::NotChecked) => Verdict::Incomplete,
                Some(Severity::Note) | None => Verdict::Verified,
            },
            name: self
                .state
                .as_ref()
                .map(|state| state.genesis().name.clone()),
            network: self.state.as_ref().map(|state| state.network().to_string()),
            entries: self.verified.map_or(0, |(size, _)| size),
            checkpoints: self.checkpoints,
            root: self.verified.map(|(_, root)| root.to_string()),
            state: self.state.as_ref().map(|state| state.digest().to_string()),
            rules: self.state.as_ref().map(|state| state.rules().clone()),
            unsaved: self.unsaved,
            unread,
            findings,
        }
    }
}

/// Whether the rules allow the entry. The thread that read the entry has verified its signatures.
fn allowed(
    state: &State,
    entry: &Entry,
    authentic: &Result<AuthenticEntry<'_>, RuleViolation>,
) -> Result<(), RuleViolation> {
    match authentic {
        Ok(authentic) => state.check_authentic(authentic),
        // A wrong version or time is reported first, as when an entry is appended.
        Err(violation) => state.check(entry).and(Err(violation.clone())),
    }
}

/// Checks the checkpoint of `after`'s size. It may be missing within a group, but not where it is `needed`.
fn check_checkpoint(
    signed: Option<&Result<Checkpoint, String>>,
    after: &Checkpoint,
    needed: bool,
) -> Result<(), String> {
    match signed {
        None if needed => Err("the checkpoint after the entry is missing".into()),
        None => Ok(()),
        Some(Err(why)) => Err(why.clone()),
        Some(Ok(signed)) if signed == after => Ok(()),
        Some(Ok(signed)) => Err(format!(
            "the checkpoint signs root {} of {} entries, but the first {} entries have root {}",
            signed.root, signed.size, after.size, after.root
        )),
    }
}
