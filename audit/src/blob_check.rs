//! Checks the blobs in a ledger's folder: each has the SHA-256 that is its name. [`crate::auditor`] checks proofs and averages.

use zk0_circuits::Digest;
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_ledger::replay::{Finding, Recheck};
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::rules::named_blobs::named_blobs;
use zk0_protocol::rules::state::State;

/// Checks the blobs that the ledger names during a replay: hand it to [`zk0_ledger::replay::replay`].
#[derive(Clone, Copy, Debug, Default)]
pub struct BlobCheck;

impl Recheck for BlobCheck {
    fn genesis(&mut self, genesis: &Genesis, blobs: &Blobs) -> Vec<Finding> {
        check(0, &Body::Genesis(genesis.clone()), blobs)
    }

    fn entry(&mut self, _: &State, index: u64, entry: &Entry, blobs: &Blobs) -> Vec<Finding> {
        check(index, &entry.body, blobs)
    }
}

fn check(index: u64, body: &Body, blobs: &Blobs) -> Vec<Finding> {
    named_blobs(body)
        .iter()
        .filter_map(|blob| whole(index, &blob.digest, blobs))
        .collect()
}

fn whole(index: u64, digest: &Digest, blobs: &Blobs) -> Option<Finding> {
    match blobs.check(digest) {
        Ok(()) => None,
        Err(BlobError::Missing(_)) => Some(Finding::note(
            index,
            format!("blob {digest} is not in this folder"),
        )),
        Err(error) => Some(Finding::fault(index, error.to_string())),
    }
}
