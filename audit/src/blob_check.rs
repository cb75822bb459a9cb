//! Checks that each blob in a ledger's folder has the SHA-256 of its name.

use crate::checks::pruning_waiver::PruningWaiver;
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_ledger::replay::{Finding, Recheck};
use zk0_protocol::counted::counted;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::pruning::Pruning;
use zk0_protocol::rules::named_blobs::{named_blobs, NamedBlob};
use zk0_protocol::rules::state::State;

/// Checks the ledger's blobs during a replay ([`zk0_ledger::replay::replay`]).
#[derive(Clone, Copy, Debug, Default)]
pub struct BlobCheck {
    pruning: Option<Pruning>,
    /// How many of those are missing.
    pruned: u64,
}

impl Recheck for BlobCheck {
    fn genesis(&mut self, genesis: &Genesis, blobs: &Blobs) -> Vec<Finding> {
        self.check(None, 0, &Body::Genesis(genesis.clone()), blobs)
    }

    fn pruned(&mut self, pruning: &Pruning) {
        self.pruning = Some(*pruning);
    }

    fn entry(&mut self, before: &State, index: u64, entry: &Entry, blobs: &Blobs) -> Vec<Finding> {
        let round = before.round().map(|round| round.number());
        self.check(round, index, &entry.body, blobs)
    }

    fn summary(&mut self) -> Vec<Finding> {
        let note = |pruning: Pruning| {
            let pruned = counted(self.pruned, "such blob is", "such blobs are");
            Finding::note(None, format!("{pruning}; {pruned} not in this folder"))
        };
        self.pruning.map(note).into_iter().collect()
    }
}

impl BlobCheck {
    fn check(
        &mut self,
        round: Option<u64>,
        index: u64,
        body: &Body,
        blobs: &Blobs,
    ) -> Vec<Finding> {
        let mut found = Vec::new();
        for NamedBlob { digest, kind } in named_blobs(body) {
            let waiver = round.map(|round| PruningWaiver::of(self.pruning, round, index));
            match blobs.check(&digest) {
                Ok(()) => {}
                Err(BlobError::Missing(_)) if waiver.is_some_and(|one| one.covers(&kind)) => {
                    self.pruned += 1;
                }
                Err(BlobError::Missing(_)) => found.push(Finding::note(
                    index,
                    format!("blob {digest} is not in this folder"),
                )),
                Err(error) => found.push(Finding::fault(index, error.to_string())),
            }
        }
        found
    }
}
