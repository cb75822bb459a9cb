//! A caller's checks besides the ledger itself.

use super::report::Finding;
use crate::blobs::Blobs;
use zk0_protocol::pruning::Pruning;
use zk0_protocol::{Entry, Genesis, State};

/// An auditor's further checks of each entry: proofs, refusals, aggregation. The replay first verifies the entry's bytes, tree and
/// checkpoint. The calls come in order, though from several threads.
pub trait Recheck: Send {
    /// The replay begins. The log has so many entries.
    fn begin(&mut self, _entries: u64) {}

    /// Takes the operator's statement about pruned blobs, before any entry but the genesis.
    fn pruned(&mut self, _pruning: &Pruning) {}

    /// Checks the genesis.
    fn genesis(&mut self, _genesis: &Genesis, _blobs: &Blobs) -> Vec<Finding> {
        Vec::new()
    }

    /// Checks an entry that the rules allow in the state `before`. Other threads may do long checks, so the findings are about this and
    /// earlier entries, in order.
    fn entry(
        &mut self,
        _before: &State,
        _index: u64,
        _entry: &Entry,
        _blobs: &Blobs,
    ) -> Vec<Finding> {
        Vec::new()
    }

    /// Waits for the other threads' checks, and returns their findings.
    fn settle(&mut self) -> Vec<Finding> {
        Vec::new()
    }

    /// Whether a later replay may go on from here. If not, some check is left, and an earlier replay's file stays. Called after
    /// [`Recheck::settle`].
    fn may_be_saved(&self) -> bool {
        true
    }

    /// What another process needs to go on from here. Called after [`Recheck::settle`].
    fn save(&self) -> Vec<u8> {
        Vec::new()
    }

    /// Findings about the whole log, at the end.
    fn summary(&mut self) -> Vec<Finding> {
        Vec::new()
    }
}

impl Recheck for () {}
