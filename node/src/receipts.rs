//! Keeps the receipts of a node's entries on the ledger.

use crate::error::ParticipantError;
use crate::state_files;
use std::fs;
use std::path::Path;
use zk0_protocol::blob::blob_digest;
use zk0_protocol::tlog::tlog_proof::MAX_PROOF_BYTES;
use zk0_protocol::{Genesis, Receipt, TlogProof};

/// Keeps a receipt in the state folder, as a C2SP tlog-proof. This file shows anyone that the log has signed the entry, whatever the log
/// shows later.
///
/// # Errors
/// The file system fails. [`ParticipantError::Forked`]: the log has signed another entry with this number; both proofs are kept.
pub fn keep(state: &Path, genesis: &Genesis, receipt: Receipt) -> Result<(), ParticipantError> {
    let receipts = state.join("receipts");
    fs::create_dir_all(&receipts).map_err(state_files::at(&receipts))?;
    let (index, entry) = (receipt.index, receipt.entry.clone());
    let path = receipts.join(format!("entry-{index}.tlog-proof"));
    let proof = TlogProof::from(receipt).encode();
    let other = signed(&path, genesis)?.filter(|signed| *signed != entry);
    if other.is_none() {
        return state_files::write(&path, &proof);
    }
    let digest = blob_digest(&entry).to_string();
    let beside = receipts.join(format!("entry-{index}.{}.tlog-proof", &digest[..16]));
    state_files::write(&beside, &proof)?;
    Err(ParticipantError::Forked {
        index,
        kept: path,
        beside,
    })
}

/// The entry in a kept proof of this network.
fn signed(path: &Path, genesis: &Genesis) -> Result<Option<Vec<u8>>, ParticipantError> {
    let Some(bytes) = state_files::read(path, MAX_PROOF_BYTES as u64)? else {
        return Ok(None);
    };
    let proof =
        TlogProof::decode(&bytes).map_err(|error| state_files::broken(path, error.to_string()))?;
    let kept = Receipt {
        index: proof.index,
        entry: proof.extra.unwrap_or_default(),
        checkpoint: proof.checkpoint,
        proof: proof.hashes,
    };
    let verified = kept.verify_keyed(&genesis.log_key, genesis.origin());
    let network = genesis.network_id();
    let counts = verified.is_ok_and(|(signed, _)| signed.check_network(&network).is_ok());
    Ok(counts.then_some(kept.entry))
}
