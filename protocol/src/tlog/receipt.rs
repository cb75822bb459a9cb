//! Receipts: a node's evidence that its entry is in the log.

use crate::entries::codec::EntryError;
use crate::tlog::checkpoint::{Checkpoint, CheckpointError, KeyedCheckpoint};
use crate::Entry;
use borsh::{BorshDeserialize, BorshSerialize};
use tlog_tiles::tlog::{check_record, record_hash, Hash};
use zk0_circuits::Digest;

/// A signed checkpoint, and an entry's inclusion in its tree.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Receipt {
    /// The entry's position, from 0.
    pub index: u64,
    /// Its canonical encoding.
    pub entry: Vec<u8>,
    /// The signed checkpoint (C2SP signed note) of a tree with the entry.
    pub checkpoint: Vec<u8>,
    /// RFC 6962 audit path, from the leaf upwards.
    pub proof: Vec<Digest>,
}

/// Why a receipt is not valid.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReceiptError {
    /// Its checkpoint is not valid.
    #[error("receipt: {0}")]
    Checkpoint(#[from] CheckpointError),
    /// Its bytes are not an entry.
    #[error("receipt: {0}")]
    Entry(#[from] EntryError),
    /// Its path does not lead to the checkpoint's root.
    #[error("receipt: the proof does not show that entry {index} is in the tree of {size} entries: {why}")]
    NotIncluded { index: u64, size: u64, why: String },
}

impl Receipt {
    /// Verifies the checkpoint's signature and the inclusion proof. Returns the checkpoint and the entry. `founding` is the log's founding
    /// key.
    pub fn verify(
        &self,
        founding: &[u8; 32],
        origin: &str,
    ) -> Result<(Checkpoint, Entry), ReceiptError> {
        let (signed, entry) = self.verify_keyed(founding, origin)?;
        Ok((signed.checkpoint, entry))
    }

    /// [`Receipt::verify`], with the key that signed.
    pub fn verify_keyed(
        &self,
        founding: &[u8; 32],
        origin: &str,
    ) -> Result<(KeyedCheckpoint, Entry), ReceiptError> {
        let signed = KeyedCheckpoint::open(&self.checkpoint, origin, founding)?;
        let checkpoint = signed.checkpoint;
        let entry = Entry::decode(&self.entry)?;
        let refuse = |why: String| ReceiptError::NotIncluded {
            index: self.index,
            size: checkpoint.size,
            why,
        };
        // The tree's height limits the path, and `check_record` copies it once for each level.
        if self.proof.len() > 64 {
            return Err(refuse(format!(
                "it has {} hashes, which is too many",
                self.proof.len()
            )));
        }
        check_record(
            &self.proof.iter().map(|digest| Hash(digest.0)).collect(),
            checkpoint.size,
            Hash(checkpoint.root.0),
            self.index,
            record_hash(&self.entry),
        )
        .map_err(|error| refuse(error.to_string()))?;
        Ok((signed, entry))
    }
}
