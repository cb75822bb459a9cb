//! Whether a ledger's folder is whole: every blob that the ledger names and that is there is what its name says. Proofs and
//! averages are for [`crate::audit`].

use zk0_circuits::Digest;
use zk0_ledger::{
    blobs::{BlobError, Blobs},
    entry::{Entry, Genesis},
    mirror::named,
    replay::{Finding, Recheck},
    state::State,
};

/// Checks blobs during a replay: hand it to [`zk0_ledger::replay::replay`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Fsck;

impl Recheck for Fsck {
    fn genesis(&mut self, genesis: &Genesis, blobs: &Blobs) -> Vec<Finding> {
        [genesis.policy, genesis.initial.blob]
            .iter()
            .filter_map(|digest| whole(0, digest, blobs))
            .collect()
    }

    fn entry(&mut self, before: &State, index: u64, entry: &Entry, blobs: &Blobs) -> Vec<Finding> {
        named(&entry.body, before.rules())
            .iter()
            .filter_map(|(digest, _)| whole(index, digest, blobs))
            .collect()
    }
}

fn whole(index: u64, digest: &Digest, blobs: &Blobs) -> Option<Finding> {
    match blobs.check(digest) {
        Ok(()) => None,
        Err(BlobError::Missing(_)) => {
            Some(Finding::note(index, format!("blob {digest} is not kept")))
        }
        Err(error) => Some(Finding::fault(index, error.to_string())),
    }
}
