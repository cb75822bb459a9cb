//! The append-only log: entries in, receipts out. On disk before it is acknowledged, and never two histories.
//!
//! A ledger's folder:
//!
//! | path | content |
//! |---|---|
//! | `log/` | the database ([`crate::store`]) |
//! | `checkpoint` | the newest signed checkpoint, outside the database, so that a restored backup of the database is noticed |
//! | `blobs/sha256/` | content-addressed proofs, weights and leaf lists ([`crate::blobs`]) |
//! | `policy` | where checkpoints are witnessed: the witnesses and the quorum ([`crate::policy`]) |
//! | `cosigned` | there too: the newest checkpoint with its quorum of cosignatures, the one that is published |

use crate::{
    blobs::Blobs,
    checkpoint::Checkpoint,
    entry::{Body, Entry, Genesis, ENTRY_VERSION},
    error::{io_error, LedgerError},
    folder,
    history::History,
    receipt::Receipt,
    state::State,
    store::Store,
    tree::Frontier,
};
use ed25519_dalek::SigningKey;
use std::{
    fs,
    path::{Path, PathBuf},
};
use tlog_tiles::tlog::{prove_record, prove_tree};
use zk0_circuits::Digest;

/// A ledger open for writing, by its one writer.
pub struct Ledger {
    dir: PathBuf,
    store: Store,
    blobs: Blobs,
    key: SigningKey,
    tree: Frontier,
    state: State,
    checkpoint: Vec<u8>,
    poisoned: bool,
}

impl Ledger {
    /// Founds a ledger in `dir`, which must not hold one. Returns it with the genesis' receipt.
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
        fs::create_dir_all(dir).map_err(io_error(dir))?;
        let store = Store::open(&folder::database(dir))?;
        if store.keys().next().is_some() {
            return Err(LedgerError::AlreadyExists(dir.into()));
        }
        let mut ledger = Self {
            dir: dir.into(),
            store,
            blobs: Blobs::at(dir),
            key,
            tree: Frontier::default(),
            state,
            checkpoint: Vec::new(),
            poisoned: false,
        };
        folder::sync(dir)?;
        if let Some(parent) = dir.parent().filter(|parent| parent.is_dir()) {
            folder::sync(parent)?;
        }
        ledger.write(&bytes)?;
        let receipt = ledger.receipt(0)?;
        Ok((ledger, receipt))
    }

    /// Opens the ledger in `dir` for writing. The whole history is read: every entry against the rules, every hash of the
    /// tree, and the root against the signed checkpoint in the file. If `network` is given it has to be that one.
    pub fn open(
        dir: &Path,
        network: Option<&Digest>,
        key: SigningKey,
    ) -> Result<Self, LedgerError> {
        let path = folder::database(dir);
        if !path.exists() {
            return Err(LedgerError::NoLedger(dir.into()));
        }
        // First without writing: RocksDB's own recovery would make a loss permanent.
        let published = folder::read_checkpoint(dir)?;
        History::read(
            &Store::open_read_only(&path)?,
            dir,
            network,
            published.as_deref(),
        )?;
        let store = Store::open(&path)?;
        let published = folder::read_checkpoint(dir)?;
        let history = History::read(&store, dir, network, published.as_deref())?;
        let state = history.state;
        if state.genesis().log_key != key.verifying_key().to_bytes() {
            return Err(LedgerError::OtherKey(*state.network()));
        }
        // Killed between committing an entry and publishing its checkpoint: publish it now.
        if published.as_deref() != Some(&history.checkpoint) {
            folder::write_checkpoint(dir, &history.checkpoint)?;
        }
        let blobs = Blobs::at(dir);
        blobs.remove_unfinished()?;
        Ok(Self {
            dir: dir.into(),
            store,
            blobs,
            key,
            tree: history.tree,
            state,
            checkpoint: history.checkpoint,
            poisoned: false,
        })
    }

    /// Appends an entry if the rules allow it. When this returns, entry and checkpoint are on disk and the receipt may be
    /// handed out. Its time is `time_ms`, or that of the entry before if the clock went back.
    pub fn append(&mut self, time_ms: u64, body: Body) -> Result<Receipt, LedgerError> {
        if self.poisoned {
            return Err(LedgerError::Poisoned);
        }
        let entry = Entry {
            version: ENTRY_VERSION,
            time_ms: self.time_ms(time_ms),
            body,
        };
        let bytes = entry.encode()?;
        self.state.check(&entry)?;
        let index = self.tree.size();
        self.write(&bytes)?;
        self.state.enact(&self.tree.root()?, &entry);
        self.receipt(index)
    }

    /// The time an entry gets that is recorded now: the clock's, but never before the last entry's.
    pub fn time_ms(&self, clock_ms: u64) -> u64 {
        clock_ms.max(self.state.time_ms())
    }

    /// Commits, then publishes. A failure leaves what is on disk unknown: nothing is written after it.
    fn write(&mut self, entry: &[u8]) -> Result<(), LedgerError> {
        self.poisoned = true;
        let index = self.tree.size();
        let hashes = self.tree.push(entry)?;
        let (size, root) = (self.tree.size(), self.tree.root()?);
        let checkpoint = Checkpoint { size, root }
            .sign(self.state.genesis().origin(), &self.key)
            .map_err(|error| LedgerError::Checkpoint { size, error })?;
        self.store.append(index, entry, &hashes, &checkpoint)?;
        folder::write_checkpoint(&self.dir, &checkpoint)?;
        self.checkpoint = checkpoint;
        self.poisoned = false;
        Ok(())
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

    /// The folder.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// One entry.
    pub fn entry(&self, index: u64) -> Result<Entry, LedgerError> {
        let bytes = self
            .store
            .entry(index)?
            .ok_or(LedgerError::NoEntry(index))?;
        Ok(Entry::decode(&bytes)?)
    }

    /// Proof that entry `index` is in the tree of the newest checkpoint.
    pub fn receipt(&self, index: u64) -> Result<Receipt, LedgerError> {
        self.receipt_at(self.tree.size(), index)
    }

    /// The receipt that [`Ledger::append`] gave for entry `index`: its checkpoint is the first that covers the entry, the
    /// one a challenge follows from.
    pub fn first_receipt(&self, index: u64) -> Result<Receipt, LedgerError> {
        self.receipt_at(index.saturating_add(1), index)
    }

    /// Proof that entry `index` is in the tree of the first `size` entries, with the checkpoint of that size.
    pub fn receipt_at(&self, size: u64, index: u64) -> Result<Receipt, LedgerError> {
        let (Some(entry), Some(checkpoint)) =
            (self.store.entry(index)?, self.store.checkpoint(size)?)
        else {
            return Err(LedgerError::NoEntry(index));
        };
        let proof = prove_record(size, index, &self.store)?;
        Ok(Receipt {
            index,
            entry,
            checkpoint,
            proof: proof.into_iter().map(|hash| Digest(hash.0)).collect(),
        })
    }

    /// The log's checkpoint of the first `size` entries, with its signature alone.
    pub fn checkpoint_at(&self, size: u64) -> Result<Vec<u8>, LedgerError> {
        let missing = || LedgerError::NoEntry(size.saturating_sub(1));
        self.store.checkpoint(size)?.ok_or_else(missing)
    }

    /// RFC 6962 consistency proof from the tree of the first `size` entries to the newest checkpoint's.
    pub fn consistency(&self, size: u64) -> Result<Vec<Digest>, LedgerError> {
        self.consistency_between(size, self.tree.size())
    }

    /// RFC 6962 consistency proof from the tree of the first `old` entries to that of the first `new`.
    pub fn consistency_between(&self, old: u64, new: u64) -> Result<Vec<Digest>, LedgerError> {
        let proof = prove_tree(new, old, &self.store)?;
        Ok(proof.into_iter().map(|hash| Digest(hash.0)).collect())
    }
}
