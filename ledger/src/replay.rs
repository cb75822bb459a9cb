//! An auditor's replay: read a ledger's folder from the first byte, believe nothing, and report.

use crate::{
    blobs::Blobs,
    checkpoint::Checkpoint,
    error::LedgerError,
    folder,
    group::needs_checkpoint,
    history::check_network,
    state::State,
    store::{Key, Store},
    tree::Frontier,
    Entry, Genesis,
};
use serde::Serialize;
use std::{path::Path, thread::sleep, time::Duration};
use tlog_tiles::tlog::{stored_hash_count, stored_hash_index, HashReader};
use zk0_circuits::Digest;

/// What else an auditor checks, entry by entry: proofs, refusals, aggregation. The ledger itself has checked bytes, tree
/// and checkpoint by then.
pub trait Recheck {
    /// How many entries there will be.
    fn begin(&mut self, _entries: u64) {}

    /// The founding document.
    fn genesis(&mut self, _genesis: &Genesis, _blobs: &Blobs) -> Vec<Finding> {
        Vec::new()
    }

    /// An entry that the rules allow after `before`.
    fn entry(
        &mut self,
        _before: &State,
        _index: u64,
        _entry: &Entry,
        _blobs: &Blobs,
    ) -> Vec<Finding> {
        Vec::new()
    }
}

/// Checks the ledger alone.
impl Recheck for () {}

/// Something an auditor should know.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// The entry it is about.
    pub index: Option<u64>,
    /// Whether the ledger cannot be trusted because of it.
    pub severity: Severity,
    /// In words.
    pub text: String,
}

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// Something could not be checked, or deserves a look.
    Note,
    /// Something is wrong: the verdict is [`Verdict::Failed`].
    Fault,
}

/// Whether the history is what it claims to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Nothing is wrong.
    Verified,
    /// Something is: see the findings.
    Failed,
}

/// What a replay found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Report {
    /// Whether it holds.
    pub verdict: Verdict,
    /// The network's name, once the genesis was read.
    pub name: Option<String>,
    /// The network's id, in hexadecimal.
    pub network: Option<String>,
    /// Entries verified.
    pub entries: u64,
    /// Checkpoints verified.
    pub checkpoints: u64,
    /// Root of the last verified tree, in hexadecimal.
    pub root: Option<String>,
    /// Digest of the state after the last verified entry, in hexadecimal.
    pub state: Option<String>,
    /// What was found, in order.
    pub findings: Vec<Finding>,
}

impl Finding {
    /// Something that makes the replay fail.
    pub fn fault(index: impl Into<Option<u64>>, text: impl Into<String>) -> Self {
        Self {
            index: index.into(),
            severity: Severity::Fault,
            text: text.into(),
        }
    }

    /// Something worth knowing.
    pub fn note(index: impl Into<Option<u64>>, text: impl Into<String>) -> Self {
        Self {
            severity: Severity::Note,
            ..Self::fault(index, text)
        }
    }
}

/// Replays the ledger in `dir`, which may be a read-only copy or in use. If `network` is given it has to be that one.
pub fn replay(dir: &Path, network: Option<&Digest>, recheck: &mut dyn Recheck) -> Report {
    let mut replay = Replay {
        blobs: Blobs::at(dir),
        tree: Frontier::default(),
        state: None,
        checkpoints: 0,
        findings: Vec::new(),
    };
    if let Err(fault) = replay.run(dir, network, recheck) {
        replay.findings.push(fault);
    }
    replay.report()
}

struct Replay {
    blobs: Blobs,
    tree: Frontier,
    state: Option<State>,
    checkpoints: u64,
    findings: Vec<Finding>,
}

impl Replay {
    fn run(
        &mut self,
        dir: &Path,
        network: Option<&Digest>,
        recheck: &mut dyn Recheck,
    ) -> Result<(), Finding> {
        let fault = |error: LedgerError| Finding::fault(None, error.to_string());
        let (store, size) = open_published(dir).map_err(fault)?;
        check_keys(&store, size)?;
        recheck.begin(size);
        for index in 0..size {
            let fault = |why: String| Finding::fault(index, why);
            self.step(dir, network, &store, index, size, recheck)
                .map_err(fault)?;
        }
        Ok(())
    }

    /// One entry of `size`: its bytes, its hashes, the checkpoint after it, the rules, and whatever the caller checks.
    fn step(
        &mut self,
        dir: &Path,
        network: Option<&Digest>,
        store: &Store,
        index: u64,
        size: u64,
        recheck: &mut dyn Recheck,
    ) -> Result<(), String> {
        let text = |error: LedgerError| error.to_string();
        let bytes = store.entry(index).map_err(text)?;
        let bytes = bytes.ok_or("the entry is missing")?;
        let entry = Entry::decode(&bytes).map_err(|error| error.to_string())?;
        let mut tree = self.tree.clone();
        let hashes = tree.push(&bytes).map_err(|error| error.to_string())?;
        let positions: Vec<u64> = (stored_hash_index(0, index)..).take(hashes.len()).collect();
        if store.read_hashes(&positions).ok().as_ref() != Some(&hashes) {
            return Err("the stored tree hashes are not those of the entries".into());
        }
        let root = tree.root().map_err(|error| error.to_string())?;
        let after = Checkpoint {
            size: index + 1,
            root,
        };
        let needed = after.size == size || needs_checkpoint(&entry.body);
        match &mut self.state {
            None => {
                let founded = State::found(&entry).map_err(|error| error.to_string())?;
                check_network(dir, founded.network(), network).map_err(text)?;
                self.checkpoints += check_checkpoint(store, founded.genesis(), &after, needed)?;
                self.findings
                    .extend(recheck.genesis(founded.genesis(), &self.blobs));
                self.state = Some(founded);
            }
            Some(state) => {
                self.checkpoints += check_checkpoint(store, state.genesis(), &after, needed)?;
                state.check(&entry).map_err(|error| error.to_string())?;
                self.findings
                    .extend(recheck.entry(state, index, &entry, &self.blobs));
                state.enact(&root, &entry);
            }
        }
        self.tree = tree;
        Ok(())
    }

    fn report(self) -> Report {
        let failed = |finding: &Finding| finding.severity == Severity::Fault;
        Report {
            verdict: match self.state.is_none() || self.findings.iter().any(failed) {
                true => Verdict::Failed,
                false => Verdict::Verified,
            },
            name: self
                .state
                .as_ref()
                .map(|state| state.genesis().name.clone()),
            network: self.state.as_ref().map(|state| state.network().to_string()),
            entries: self.tree.size(),
            checkpoints: self.checkpoints,
            root: match self.tree.size() {
                0 => None,
                _ => self.tree.root().ok().map(|root| root.to_string()),
            },
            state: self.state.as_ref().map(|state| state.digest().to_string()),
            findings: self.findings,
        }
    }
}

/// Opens a database whose newest checkpoint is the published one; looks again if a writer seems to be at work.
fn open_published(dir: &Path) -> Result<(Store, u64), LedgerError> {
    const PAUSE: Duration = Duration::from_millis(20);
    let path = folder::database(dir);
    if !path.exists() {
        return Err(LedgerError::NoLedger(dir.into()));
    }
    let mut patience = 10;
    loop {
        let before = folder::read_checkpoint(dir)?;
        let opened = open_once(dir, &path);
        sleep(match &opened {
            Ok(_) => return opened,
            Err(_) => PAUSE,
        });
        // Committed and not yet published, or published meanwhile: both pass. Anything else stays.
        let between = matches!(&opened, Err(LedgerError::OtherPublished { published, size, .. })
            if published < size);
        patience -= 1;
        if patience == 0 || !(between || folder::read_checkpoint(dir)? != before) {
            return opened;
        }
    }
}

fn open_once(dir: &Path, path: &Path) -> Result<(Store, u64), LedgerError> {
    let published = folder::read_checkpoint(dir)?;
    let store = Store::open_read_only(path)?;
    let size = store.size()?;
    if size == 0 {
        return Err(LedgerError::NoLedger(dir.into()));
    }
    let Some(published) = published else {
        return Err(LedgerError::NoCheckpoint(folder::checkpoint(dir)));
    };
    // A writer commits before it publishes: if it published something new meanwhile, what was published before has to be in
    // the database, but not be the newest.
    let at_work = folder::read_checkpoint(dir)?.as_ref() != Some(&published);
    let claimed = claimed_size(&published).unwrap_or_default();
    let at = if at_work { claimed } else { size };
    match store.checkpoint(at)? == Some(published) {
        true => Ok((store, size)),
        false => Err(LedgerError::OtherPublished {
            path: folder::checkpoint(dir),
            published: claimed,
            size,
        }),
    }
}

/// The size a checkpoint's text claims, not verified.
fn claimed_size(text: &[u8]) -> Option<u64> {
    let line = text.split(|byte| *byte == b'\n').nth(1)?;
    std::str::from_utf8(line).ok()?.parse().ok()
}

/// Checks the checkpoint of `after`'s size, which may be missing within a group but not where it is `needed`. Returns how many
/// there are.
fn check_checkpoint(
    store: &Store,
    genesis: &Genesis,
    after: &Checkpoint,
    needed: bool,
) -> Result<u64, String> {
    let Some(text) = store
        .checkpoint(after.size)
        .map_err(|error| error.to_string())?
    else {
        return match needed {
            true => Err("the checkpoint after the entry is missing".into()),
            false => Ok(0),
        };
    };
    let signed = Checkpoint::open(&text, genesis.origin(), &genesis.log_key)
        .map_err(|error| error.to_string())?;
    match signed == *after {
        true => Ok(1),
        false => Err(format!(
            "the checkpoint signs root {} of {} entries, but {} entries have root {}",
            signed.root, signed.size, after.size, after.root
        )),
    }
}

/// Every key is one that a log of this size has, and no entry or hash is missing. Checkpoints are where groups ended.
fn check_keys(store: &Store, size: u64) -> Result<(), Finding> {
    let (mut entries, mut hashes) = (0..size, 0..stored_hash_count(size));
    for key in store.keys() {
        let key = key.map_err(|error| Finding::fault(None, error.to_string()))?;
        let expected = match key {
            Some(Key::Entry(_)) => entries.next().map(Key::Entry),
            Some(Key::Hash(_)) => hashes.next().map(Key::Hash),
            Some(Key::Checkpoint(at)) => (1..=size).contains(&at).then_some(Key::Checkpoint(at)),
            None => None,
        };
        if expected.is_none() || key != expected {
            let found = key.map_or("an unknown key".into(), |key| format!("{key:?}"));
            return Err(Finding::fault(
                None,
                format!(
                    "the database holds {found}, which a log of {size} entries does not have there"
                ),
            ));
        }
    }
    let missing = entries
        .next()
        .map(|index| (Some(index), "the entry is missing"))
        .or(hashes.next().map(|_| (None, "a tree hash is missing")));
    match missing {
        Some((index, text)) => Err(Finding::fault(index, text)),
        None => Ok(()),
    }
}
