//! Trouble with the store of the entries. While it does not take the newest ones, the aggregator waits. The status is then the last one,
//! with this trouble.

use crate::observe::troubles::Troubles;
use zk0_ledger::blobs::error::StoreError;
use zk0_protocol::rpc::federation::trouble::Kind;

/// For the status. The log names the store.
const NOT_TAKEN: &str =
    "the blob store does not take the newest entries, so nothing is recorded; the log of the aggregator has the reason";

/// Shows trouble, or that it is over.
pub fn show(troubles: &Troubles, failed: Option<&StoreError>) {
    match failed {
        None => troubles.clear(Kind::BlobStore),
        Some(error) => {
            // Logged once, however often it is tried.
            if troubles.lasting(Kind::BlobStore).is_none() {
                tracing::error!("nothing is recorded: {error}; this is tried again, after longer and longer waits");
            }
            troubles.raise(Kind::BlobStore, NOT_TAKEN);
        }
    }
}

/// Ready when the store does not take the newest entries.
pub async fn is_away(troubles: &Troubles) {
    let mut in_force = troubles.follow();
    let away = in_force.wait_for(|kinds| kinds.contains_key(&Kind::BlobStore));
    if away.await.is_err() {
        std::future::pending().await
    }
}
