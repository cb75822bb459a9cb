//! An auditor's replay: the caller's checks of each entry, and what earlier replays verified and later ones may use.

use super::chunk::Chunk;
use super::database::{self, OpenedDatabase};
use super::keys_ahead::keys_ahead;
use super::options::{ReplayOptions, SaveOptions};
use super::recheck::Recheck;
use super::relay;
use super::report::{Finding, ReplayReport, Severity, Verdict};
use super::saved::{SavedReplay, Saving};
use super::verified::{check_network, HistoryFold, VerifiedHistory};
use crate::blobs::Blobs;
use crate::error::LedgerError;
use crate::pruned;
use crate::store::Store;
use std::num::NonZeroUsize;
use std::path::Path;
use std::time::Instant;
use zk0_circuits::Digest;
use zk0_protocol::rules::state::State;
use zk0_protocol::tlog::checkpoint::Checkpoint;
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::{Body, Entry, Genesis};

/// Replays the ledger in `dir`, until something cannot be verified.
pub fn replay_with(
    dir: &Path,
    mut options: ReplayOptions<'_>,
    recheck: &mut dyn Recheck,
) -> ReplayReport {
    let mut auditing = Auditing {
        dir,
        network: options.network,
        recheck,
        keep: options.keep.take(),
        kept: Instant::now(),
        unsaved: None,
        blobs: Blobs::at(dir),
        findings: Vec::new(),
        before: 0,
        known_size: 0,
    };
    let mut history = None;
    let stopped = auditing.replay(options, &mut history).err();
    auditing.report(history, stopped)
}

struct Auditing<'a> {
    dir: &'a Path,
    network: Option<Digest>,
    recheck: &'a mut dyn Recheck,
    keep: Option<SaveOptions>,
    kept: Instant,
    unsaved: Option<String>,
    blobs: Blobs,
    findings: Vec<Finding>,
    /// Entries that an earlier replay verified, perhaps with the same findings.
    before: u64,
    /// The entries of `keep`'s file, if this replay starts elsewhere. The file stays until as many are verified.
    known_size: u64,
}

impl HistoryFold for Auditing<'_> {
    fn genesis(&mut self, genesis: &Genesis) {
        let found = self.recheck.genesis(genesis, &self.blobs);
        self.found(found);
    }

    fn entry(&mut self, before: &State, index: u64, entry: &Entry) {
        let found = self.recheck.entry(before, index, entry, &self.blobs);
        self.found(found);
    }

    fn pause(&mut self, verified: &VerifiedHistory) {
        let due = |keep: &SaveOptions| {
            verified.size() >= self.known_size && self.kept.elapsed() >= keep.every
        };
        if self.keep.as_ref().is_some_and(due) {
            self.save(verified);
        }
    }
}

impl Auditing<'_> {
    fn replay(
        &mut self,
        options: ReplayOptions<'_>,
        history: &mut Option<VerifiedHistory>,
    ) -> Result<(), Finding> {
        let OpenedDatabase { store, size } = match options.opened {
            Some(opened) => opened,
            None => database::open_published(self.dir)?,
        };
        database::check_keys(&store, size)?;
        self.recheck.begin(size);
        if let Some(seen) = options.seen {
            earlier_tree(&store, &seen)?;
        }
        if let Some(known) = options.known {
            self.check_continues(&store, &known)?;
            self.known_size = known.size;
        }
        let (dir, network) = (self.dir, self.network);
        let history = history.insert(match options.from {
            Some(saved) => self.resume(&store, saved)?,
            None => VerifiedHistory::found(&store, dir, network.as_ref(), self)?,
        });
        if let Some(signed) = pruned::read_within(self.dir, history.genesis(), size)? {
            // First of all: it excuses missing blobs, and what was verified so is saved on the way.
            let keys = keys_ahead(&store, history, size)?;
            signed.check_key(&keys, size)?;
            self.recheck.pruned(&signed.statement);
        }
        let threads = options
            .threads
            .map_or_else(relay::default_threads, NonZeroUsize::get);
        relay::run(&store, size, history, self, threads, options.progress)?;
        Ok(())
    }

    /// Checks that the log has an earlier replay's root at that size. Returns that tree.
    fn check_continues(&self, store: &Store, saved: &SavedReplay) -> Result<Frontier, Finding> {
        let fault = |text: String| Finding::fault(None, text);
        let founder = Chunk::read(store, 0..1, None);
        if let Some(broken) = founder.broken {
            return Err(broken.into());
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
        check_network(self.dir, &found, self.network.as_ref())
            .map_err(|error| fault(error.to_string()))?;
        let (size, root) = (saved.size, saved.root);
        earlier_tree(store, &Checkpoint { size, root })
    }

    fn resume(&mut self, store: &Store, saved: SavedReplay) -> Result<VerifiedHistory, Finding> {
        let tree = self.check_continues(store, &saved)?;
        self.findings = saved.findings;
        self.before = saved.size;
        Ok(VerifiedHistory::resume(
            saved.state,
            tree,
            saved.checkpoints,
        ))
    }

    fn found(&mut self, findings: Vec<Finding>) {
        for finding in findings {
            let again = finding.index.is_some_and(|index| index < self.before);
            if !(again && self.findings.contains(&finding)) {
                self.findings.push(finding);
            }
        }
    }

    fn save(&mut self, verified: &VerifiedHistory) {
        let found = self.recheck.settle();
        self.found(found);
        if !self.recheck.may_be_saved() {
            self.kept = Instant::now();
            return;
        }
        let Some(keep) = &self.keep else {
            return;
        };
        let saving = Saving {
            verified,
            findings: &self.findings,
            recheck: self.recheck.save(),
        };
        // A later write may succeed, when the disk has room. The last one counts.
        let written = saving.write(&keep.path);
        self.unsaved = written.err().map(|error| error.to_string());
        self.kept = Instant::now();
    }

    /// Ends the replay, early if `stopped` states why. Then nothing more is saved.
    fn report(
        mut self,
        history: Option<VerifiedHistory>,
        stopped: Option<Finding>,
    ) -> ReplayReport {
        match (&history, &stopped) {
            (Some(verified), None) => self.save(verified),
            _ => {
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
        // A replay stops at a fault, or where it cannot read.
        let unread = stopped
            .as_ref()
            .filter(|why| why.severity != Severity::Fault);
        let unread = unread.cloned();
        findings.extend(stopped);
        let worst = findings.iter().map(|finding| finding.severity).max();
        let state = history.as_ref().map(VerifiedHistory::state);
        ReplayReport {
            verdict: match worst {
                _ if state.is_none() && unread.is_none() => Verdict::Failed,
                Some(Severity::Fault) => Verdict::Failed,
                Some(Severity::NotChecked) => Verdict::Incomplete,
                Some(Severity::Note) | None => Verdict::Verified,
            },
            name: state.map(|state| state.genesis().name.clone()),
            network: state.map(|state| state.network().to_string()),
            entries: history.as_ref().map_or(0, VerifiedHistory::size),
            checkpoints: history.as_ref().map_or(0, VerifiedHistory::checkpoints),
            root: history
                .as_ref()
                .and_then(|history| Some(history.root().ok()?.to_string())),
            state: state.map(|state| state.digest().to_string()),
            rules: state.map(|state| state.rules().clone()),
            unsaved: self.unsaved,
            unread,
            findings,
        }
    }
}

/// The tree that an earlier audit verified, which must have the same root.
fn earlier_tree(store: &Store, earlier: &Checkpoint) -> Result<Frontier, Finding> {
    store.known_tree(earlier).map_err(|error| {
        let (verified, root) = (earlier.size, earlier.root);
        let text = match error {
            LedgerError::RolledBack { held, .. } => format!(
                "ROLLED BACK: an earlier audit verified {verified} entries, but now there are {held}"
            ),
            LedgerError::Forked { found, .. } => format!(
                "FORKED: the first {verified} entries have root {found}, but an earlier audit verified root {root}"
            ),
            error => format!(
                "the tree of the {verified} entries that an earlier audit verified cannot be read: {error}"
            ),
        };
        Finding::fault(None, text)
    })
}
