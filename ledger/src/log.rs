//! The append-only log. It takes entries and gives receipts. An entry is on disk before it is acknowledged. The log never has two
//! histories. Entries are committed in groups ([`crate::group`]), each whole or not at all.
//!
//! A ledger's folder:
//!
//! | path | content |
//! |---|---|
//! | `log/` | the database ([`crate::store`]) |
//! | `checkpoint` | the newest signed checkpoint, outside the database, so that a restored backup of the database is noticed |
//! | `blobs/sha256/` | content-addressed proofs, weights and leaf lists ([`crate::blobs`]) |
//! | `pruned` | which blobs are no longer kept ([`crate::pruned`]) |
//! | `policy` | the witness policy ([`zk0_protocol::tlog::witness_policy`]) |
//! | `cosigned` | with a policy, the newest checkpoint with its quorum of cosignatures: the published one |
//! | `state`, `public/` | what an aggregator keeps for its next start ([`crate::replay::KeptState`]); it may be deleted |
//!
//! - `key_rotation`: the log gets another key.

mod key_rotation;

use crate::blobs::error::{BlobError, StoreError};
use crate::blobs::Blobs;
use crate::clock::ClockWatch;
use crate::error::{io_error, LedgerError};
use crate::folder;
use crate::group::{check_key, group, TrialState, WantedEntry};
use crate::pruned;
use crate::replay::kept::{self, KeptState};
use crate::replay::{continuing, HistoryFold};
use crate::store::reader::LedgerReader;
use crate::store::{Store, StoreBatch};
use crate::stored_entries;
use ed25519_dalek::SigningKey;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::sleep;
use std::time::Duration;
use zk0_circuits::{Digest, NodeId};
use zk0_files::atomic_file::{create_folder, folder_of};
use zk0_protocol::challenge::vrf::VrfProof;
use zk0_protocol::entries::authentic::AuthenticBody;
use zk0_protocol::entries::entry::{Body, Entry, ENTRY_VERSION};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::signed::{SignableStatement, Signed};
use zk0_protocol::rules::state::State;
use zk0_protocol::rules::violation::RuleViolation;
use zk0_protocol::tlog::checkpoint::Checkpoint;
use zk0_protocol::tlog::receipt::Receipt;
use zk0_protocol::tlog::tree::Frontier;

/// The first and the longest wait for a store that does not take a group of entries. Each wait doubles the one before.
const STORE_WAITS: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(30)];

/// Takes why the store does not take a group of entries, and `None` when it has taken it.
type StoreWatch = Box<dyn Fn(Option<&StoreError>) + Send + Sync>;

/// A ledger open for writing, by one process at a time.
pub struct Ledger {
    dir: PathBuf,
    reader: LedgerReader,
    blobs: Blobs,
    key: SigningKey,
    tree: Frontier,
    state: State,
    /// A copy of the state to try groups on.
    trial: Option<Box<State>>,
    checkpoint: Vec<u8>,
    clock: Option<Arc<ClockWatch>>,
    store_watch: Option<StoreWatch>,
    poisoned: bool,
    /// An entry in whose place the store has another one.
    fenced: Option<u64>,
}

impl Ledger {
    /// Founds a ledger in `dir`, which must hold none, and returns its genesis' receipt.
    pub fn create(
        dir: &Path,
        genesis: Genesis,
        key: SigningKey,
        time_ms: u64,
    ) -> Result<(Self, Receipt), LedgerError> {
        let entry = Entry {
            version: ENTRY_VERSION,
            time_ms,
            body: Body::Genesis(genesis),
        };
        let state = State::found(&entry)?;
        let bytes = entry.encode()?;
        if state.genesis().log_key != key.verifying_key().to_bytes() {
            return Err(LedgerError::OtherKey(*state.network()));
        }
        if folder::checkpoint(dir).exists() {
            return Err(LedgerError::AlreadyExists(dir.into()));
        }
        create_folder(dir).map_err(io_error(dir))?;
        let store = Store::open(&folder::database(dir))?;
        if store.keys().next().is_some() {
            return Err(LedgerError::AlreadyExists(dir.into()));
        }
        let mut ledger = Self {
            dir: dir.into(),
            reader: LedgerReader {
                store: Arc::new(store),
            },
            blobs: Blobs::at(dir),
            key,
            tree: Frontier::default(),
            state,
            trial: None,
            checkpoint: Vec::new(),
            clock: None,
            store_watch: None,
            poisoned: false,
            fenced: None,
        };
        folder::sync(dir)?;
        folder::sync(folder_of(dir))?;
        let hashes = ledger.tree.push(&bytes)?;
        let (size, root) = (1, ledger.tree.root()?);
        let checkpoint = Checkpoint { size, root }
            .sign(ledger.state.genesis().origin(), &ledger.key)
            .map_err(|error| LedgerError::Checkpoint { size, error })?;
        let mut batch = StoreBatch::default();
        batch.entry(0, &bytes, &hashes);
        batch.checkpoint(size, &checkpoint);
        ledger.write(batch, checkpoint)?;
        let receipt = ledger.receipt(0)?;
        Ok((ledger, receipt))
    }

    /// Opens the ledger in `dir` for writing. Verifies the whole history: entries by the rules, tree hashes, and the root by the signed
    /// checkpoint file. `network` is the network that it must be of.
    pub fn open(
        dir: &Path,
        network: Option<&Digest>,
        key: SigningKey,
    ) -> Result<Self, LedgerError> {
        Self::open_with(dir, network, key, Blobs::at(dir), &mut ())
    }

    /// [`Ledger::open`], with blobs perhaps kept in a store. Puts blobs and entries there that are only in the folder. Takes entries from
    /// there that are only in the store, all of them if the folder has no ledger. `fold` takes each verified entry, so that the history is
    /// read once, or goes on from a kept state ([`Ledger::kept_state`]).
    pub fn open_with(
        dir: &Path,
        network: Option<&Digest>,
        key: SigningKey,
        blobs: Blobs,
        fold: &mut dyn HistoryFold,
    ) -> Result<Self, LedgerError> {
        let log_key = key.verifying_key().to_bytes();
        let ledger = Self::open_to_rotate(dir, network, key, Some(&log_key), blobs, fold)?;
        let (genesis, keys) = (ledger.state.genesis(), ledger.state.log_keys());
        check_key(genesis, keys, &log_key)?;
        pruned::check_present(&ledger.dir, &ledger.blobs, (genesis, keys))?;
        Ok(ledger)
    }

    /// [`Ledger::open_with`], with the key that the log is to get ([`Ledger::rotate_key`]). Without `log_key`, an empty folder is filled from
    /// the store of any log.
    pub fn open_to_rotate(
        dir: &Path,
        network: Option<&Digest>,
        key: SigningKey,
        log_key: Option<&[u8; 32]>,
        blobs: Blobs,
        fold: &mut dyn HistoryFold,
    ) -> Result<Self, LedgerError> {
        let path = folder::database(dir);
        if let Some(entries) = blobs.entry_store() {
            if is_empty(dir)? {
                stored_entries::found(dir, log_key, entries)?;
            }
        }
        if !path.exists() {
            return Err(LedgerError::NoLedger(dir.into()));
        }
        // No writes at first: RocksDB's recovery would make a loss permanent.
        let mut published = folder::read_checkpoint(dir)?;
        let snapshot = Store::open_read_only(&path)?;
        let writer = NodeId(key.verifying_key().to_bytes());
        let (kept, lacking) = match kept::resumed(&snapshot, dir, network, &writer, fold) {
            Ok(history) => (Some(history), None),
            Err(lacking) => (None, lacking),
        };
        let text = published.as_deref();
        let mut history = continuing::verify_from(kept, &snapshot, dir, network, text, fold)?;
        drop(snapshot);
        let store = Store::open(&path)?;
        let newest = store.checkpoint(store.size()?)?;
        if newest.as_deref() != Some(history.checkpoint()) {
            // Another process has written meanwhile. Now none can.
            published = folder::read_checkpoint(dir)?;
            continuing::verify_rest(&store, dir, published.as_deref(), &mut history, fold)?;
        }
        // The store may have a change of the key.
        if let (Some(log_key), None) = (log_key, blobs.entry_store()) {
            check_key(history.genesis(), history.state().log_keys(), log_key)?;
        }
        blobs.remove_unfinished()?;
        let stored = blobs.store_all()?;
        if let (Some(address), true) = (blobs.store_address(), stored > 0) {
            tracing::info!(
                "{stored} blobs of {} were put into the blob store {address}",
                dir.display()
            );
        }
        // After the blobs that they name.
        if let Some(entries) = blobs.entry_store() {
            let known = (history.genesis(), history.state().log_keys());
            if stored_entries::reconcile(dir, &store, known, entries)? {
                published = folder::read_checkpoint(dir)?;
                continuing::verify_rest(&store, dir, published.as_deref(), &mut history, fold)?;
            }
            let known = (history.genesis(), history.state().log_keys());
            pruned::reconcile(dir, known, entries)?;
        }
        if let Some(signed) = lacking {
            kept::check_signed(&store, dir, &signed)?;
        }
        let (state, tree, checkpoint) = history.into_parts();
        // The writer was killed between a commit and the checkpoint's publication.
        if published.as_deref() != Some(&checkpoint) {
            folder::write_checkpoint(dir, &checkpoint)?;
        }
        Ok(Self {
            dir: dir.into(),
            reader: LedgerReader {
                store: Arc::new(store),
            },
            blobs,
            key,
            tree,
            state,
            trial: None,
            checkpoint,
            clock: None,
            store_watch: None,
            poisoned: false,
            fenced: None,
        })
    }

    /// Appends an entry if the rules allow it. It is then on disk with its checkpoint, and the receipt may be handed out. Its time is
    /// `time_ms`, or that of the entry before it if the clock went back.
    pub fn append(&mut self, time_ms: u64, body: Body) -> Result<Receipt, LedgerError> {
        let body = AuthenticBody::of(body)?;
        match self.commit(vec![WantedEntry { time_ms, body }])?.pop() {
            Some(outcome) => self.first_receipt(outcome?),
            None => Err(LedgerError::NoEntry(self.size())),
        }
    }

    /// Appends entries as one group: one write to disk, and a checkpoint at the end and after each entry from whose tree something follows.
    /// Leaves out entries that the rules refuse after those before them. All others are then on disk. Returns each entry's index, or why it
    /// is refused. [`LedgerReader::first_receipt`] gives the receipts.
    ///
    /// The time is proportional to the group's size. The first group of several entries also copies the state.
    ///
    /// # Errors
    /// Nothing is recorded: the clock is wrong, or the disk failed.
    pub fn commit(
        &mut self,
        wanted: Vec<WantedEntry>,
    ) -> Result<Vec<Result<u64, RuleViolation>>, LedgerError> {
        self.check_writable()?;
        let latest_ms = wanted.iter().map(|one| one.time_ms).max();
        if let (Some(clock), Some(latest_ms)) = (&self.clock, latest_ms) {
            clock.check(latest_ms)?;
        }
        let mut time_ms = self.state.time_ms();
        let mut entries = Vec::with_capacity(wanted.len());
        for one in wanted {
            time_ms = time_ms.max(one.time_ms);
            entries.push(one.body.at(time_ms));
        }
        if entries.is_empty() {
            return Ok(Vec::new());
        }
        let mut trial = match entries.len() {
            1 => TrialState::Single(&self.state),
            _ => TrialState::Copy(
                self.trial
                    .take()
                    .unwrap_or_else(|| Box::new(self.state.clone())),
            ),
        };
        let group = group(&entries, &self.tree, &mut trial, &self.key)?;
        let tried = match trial {
            TrialState::Single(_) => None,
            TrialState::Copy(state) => Some(state),
        };
        let mut index = self.tree.size();
        if group.tree.size() > index {
            self.store_group(index, &group.batch)?;
            self.write(group.batch, group.checkpoint)?;
            self.tree = group.tree;
        }
        let mut outcomes = Vec::with_capacity(entries.len());
        for (outcome, entry) in group.outcomes.into_iter().zip(&entries) {
            let entry = entry.entry();
            outcomes.push(outcome.map(|root| {
                self.state.enact(&root, &entry);
                if let Some(behind) = &mut self.trial {
                    behind.enact(&root, &entry);
                }
                index += 1;
                index - 1
            }));
        }
        self.trial = tried.or(self.trial.take());
        Ok(outcomes)
    }

    /// From now on, refuses entries if the clock has moved further than time has passed ([`crate::clock`]). `clock_ms` is its time now, and
    /// must not be far before the last entry. `steady` reads a clock that cannot be set.
    pub fn watch_clock(
        &mut self,
        clock_ms: u64,
        steady: impl Fn() -> Duration + Send + Sync + 'static,
    ) -> Result<Arc<ClockWatch>, LedgerError> {
        let last_ms = self.state.time_ms();
        let watch = Arc::new(ClockWatch::begin(clock_ms, last_ms, steady)?);
        self.clock = Some(watch.clone());
        Ok(watch)
    }

    /// The clock's time for an entry, never before the last entry's.
    pub fn time_ms(&self, clock_ms: u64) -> u64 {
        clock_ms.max(self.state.time_ms())
    }

    /// Commits, then publishes. After a failure, the disk's content is unknown, so writing stops.
    fn write(&mut self, batch: StoreBatch, checkpoint: Vec<u8>) -> Result<(), LedgerError> {
        self.poisoned = true;
        self.reader.store.commit(batch)?;
        folder::write_checkpoint(&self.dir, &checkpoint)?;
        self.checkpoint = checkpoint;
        self.poisoned = false;
        Ok(())
    }

    /// Puts a group into the store of the entries, if any. Waits while the store does not answer, because it may have the group.
    fn store_group(&mut self, first: u64, batch: &StoreBatch) -> Result<(), LedgerError> {
        let Some(entries) = self.blobs.entry_store() else {
            return Ok(());
        };
        let group = stored_entries::encode_batch(batch);
        let tell = |failed: Option<&StoreError>| {
            if let Some(watch) = &self.store_watch {
                watch(failed);
            }
        };
        let [mut wait, longest] = STORE_WAITS;
        loop {
            match stored_entries::put(entries, first, &group) {
                Err(LedgerError::Blob(BlobError::Store(failed))) => {
                    tell(Some(&failed));
                    sleep(wait);
                    wait = longest.min(wait * 2);
                }
                Ok(()) => {
                    tell(None);
                    return Ok(());
                }
                Err(error) => {
                    self.fenced = Some(first);
                    return Err(error);
                }
            }
        }
    }

    /// Tells `watch` why the store does not take a group of entries, and `None` when it has taken it.
    pub fn watch_store(&mut self, watch: impl Fn(Option<&StoreError>) + Send + Sync + 'static) {
        self.store_watch = Some(Box::new(watch));
    }

    /// Whether entries can be recorded.
    ///
    /// # Errors
    /// A write has failed, or another aggregator writes this log. Nothing is written until the next opening.
    pub fn check_writable(&self) -> Result<(), LedgerError> {
        match self.fenced {
            Some(index) => Err(LedgerError::OtherEntries {
                address: self.blobs.store_address().unwrap_or_default().into(),
                index,
            }),
            None if self.poisoned => Err(LedgerError::Poisoned),
            None => Ok(()),
        }
    }

    /// The state after the last entry, for the next opening by this build, with what its fold keeps.
    pub fn kept_state(&self, build: Digest, fold: Vec<u8>) -> KeptState {
        let verified = (self.state.clone(), self.tree.clone());
        KeptState::new(&self.dir, build, verified, fold, self.key.clone())
    }

    pub(crate) fn sign<T: SignableStatement>(&self, statement: T) -> Signed<T> {
        Signed::new(statement, &self.key)
    }

    /// The log's verifiable random function of `input`, with its proof.
    pub fn vrf(&self, input: &Digest) -> VrfProof {
        VrfProof::of(&self.key, &input.0)
    }

    /// Reads entries and receipts, also during writes.
    pub fn reader(&self) -> &LedgerReader {
        &self.reader
    }

    /// The state after the last entry.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Number of entries.
    pub fn size(&self) -> u64 {
        self.tree.size()
    }

    /// The newest signed checkpoint.
    pub fn checkpoint(&self) -> &[u8] {
        &self.checkpoint
    }

    /// The blobs beside the log.
    pub fn blobs(&self) -> &Blobs {
        &self.blobs
    }

    /// The ledger's folder.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Proves that entry `index` is in the newest checkpoint's tree.
    pub fn receipt(&self, index: u64) -> Result<Receipt, LedgerError> {
        self.receipt_at(self.tree.size(), index)
    }
}

impl Deref for Ledger {
    type Target = LedgerReader;

    fn deref(&self) -> &LedgerReader {
        &self.reader
    }
}

/// Whether the folder has no ledger, not even a part of one.
fn is_empty(dir: &Path) -> Result<bool, LedgerError> {
    let path = folder::database(dir);
    let has_entries = Store::is_in(&path) && Store::open_read_only(&path)?.size()? > 0;
    Ok(!has_entries && folder::read_checkpoint(dir)?.is_none())
}
