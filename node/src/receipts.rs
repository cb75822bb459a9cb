//! Keeps the receipts of what a node has put on the ledger.

use crate::error::ParticipantError;
use crate::state_files;
use std::fs;
use std::path::Path;
use zk0_protocol::{Receipt, TlogProof};

/// Keeps a receipt in the state folder, as a C2SP tlog-proof. With this file the node can show anyone that the log has signed the entry,
/// whatever the log says later.
pub fn keep(state: &Path, receipt: Receipt) -> Result<(), ParticipantError> {
    let receipts = state.join("receipts");
    fs::create_dir_all(&receipts).map_err(state_files::at(&receipts))?;
    let path = receipts.join(format!("entry-{}.tlog-proof", receipt.index));
    state_files::write(&path, &TlogProof::from(receipt).encode())
}
