//! What the service shows of the store of the entries. While it does not take the newest ones, they are not acknowledged, and nobody else gets
//! the aggregator. So the status is then the last one, with this trouble.

use crate::observe::troubles::Troubles;
use zk0_ledger::blobs::error::StoreError;
use zk0_protocol::rpc::federation::trouble::Kind;

/// What the status says. The log names the store.
const NOT_TAKEN: &str =
    "the blob store does not take the newest entries, so nothing is recorded; the log of the aggregator says why";

/// Shows trouble, or that it is over.
pub fn show(troubles: &Troubles, failed: Option<&StoreError>) {
    match failed {
        None => troubles.clear(Kind::BlobStore),
        Some(error) => {
            // It is tried again and again, so the log says it once.
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
