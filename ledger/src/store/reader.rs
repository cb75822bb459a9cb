//! Reads a log beside its writer: entries and receipts, which never change. Reader and writer never wait for each other.

use super::Store;
use crate::error::LedgerError;
use std::sync::Arc;
use tlog_tiles::tlog::{prove_record, prove_tree};
use zk0_circuits::Digest;
use zk0_protocol::entries::entry::Entry;
use zk0_protocol::tlog::checkpoint::Checkpoint;
use zk0_protocol::tlog::receipt::Receipt;

/// Reads a log beside its writer. Clones share the database.
#[derive(Clone)]
pub struct LedgerReader {
    pub(crate) store: Arc<Store>,
}

impl LedgerReader {
    /// One entry.
    pub fn entry(&self, index: u64) -> Result<Entry, LedgerError> {
        let bytes = self
            .store
            .entry(index)?
            .ok_or(LedgerError::NoEntry(index))?;
        Ok(Entry::decode(&bytes)?)
    }

    /// The receipt that [`Ledger::append`] gave for entry `index`. Its checkpoint is the first that covers it.
    ///
    /// [`Ledger::append`]: crate::log::Ledger::append
    pub fn first_receipt(&self, index: u64) -> Result<Receipt, LedgerError> {
        let missing = || LedgerError::NoEntry(index);
        let after = index.checked_add(1).ok_or_else(missing)?;
        let covering = self.store.checkpoint_from(after)?;
        let (size, checkpoint) = covering.ok_or_else(missing)?;
        self.receipt_with(size, checkpoint, index)
    }

    /// Proves that entry `index` is among the first `size` entries, with that size's checkpoint. A group must have ended there.
    pub fn receipt_at(&self, size: u64, index: u64) -> Result<Receipt, LedgerError> {
        self.receipt_with(size, self.checkpoint_at(size)?, index)
    }

    fn receipt_with(
        &self,
        size: u64,
        checkpoint: Vec<u8>,
        index: u64,
    ) -> Result<Receipt, LedgerError> {
        let missing = || LedgerError::NoEntry(index);
        let entry = self.store.entry(index)?.ok_or_else(missing)?;
        let proof = prove_record(size, index, &*self.store)?;
        Ok(Receipt {
            index,
            entry,
            checkpoint,
            proof: proof.into_iter().map(|hash| Digest(hash.0)).collect(),
        })
    }

    /// The checkpoint of the first `size` entries, without cosignatures. A group must have ended there.
    pub fn checkpoint_at(&self, size: u64) -> Result<Vec<u8>, LedgerError> {
        let missing = LedgerError::NoCheckpointAt(size);
        self.store.checkpoint(size)?.ok_or(missing)
    }

    /// Checks that the log continues `signed`, a checkpoint of its own.
    ///
    /// # Errors
    /// [`LedgerError::RolledBack`] if entries are missing here, [`LedgerError::Forked`] if they differ.
    pub fn continues(&self, signed: &Checkpoint) -> Result<(), LedgerError> {
        self.store.known_tree(signed).map(drop)
    }

    /// RFC 6962 consistency proof from the first `old` entries to the first `new`.
    pub fn consistency_between(&self, old: u64, new: u64) -> Result<Vec<Digest>, LedgerError> {
        let proof = prove_tree(new, old, &*self.store)?;
        Ok(proof.into_iter().map(|hash| Digest(hash.0)).collect())
    }
}
