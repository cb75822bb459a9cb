//! Between what is said on the wire and what it means.

use crate::proto;
use zk0_ledger::receipt::Receipt;

impl From<Receipt> for proto::Receipt {
    fn from(receipt: Receipt) -> Self {
        Self {
            index: receipt.index,
            entry: receipt.entry,
            // Checkpoints are text by their specification.
            checkpoint: String::from_utf8_lossy(&receipt.checkpoint).into_owned(),
            inclusion: receipt.proof.iter().map(|hash| hash.0.to_vec()).collect(),
        }
    }
}
