//! What a caller checks besides the ledger itself.

use super::report::Finding;
use crate::blobs::Blobs;
use zk0_protocol::pruning::Pruning;
use zk0_protocol::{Entry, Genesis, State};

/// The checks that an auditor adds to each entry: proofs, refusals, aggregation. The replay has verified the entry's bytes, the tree and
/// the checkpoint before it calls these functions. The calls come one after the other, though not all from the same thread.
pub trait Recheck: Send {
    /// The replay begins, and the log has so many entries.
    fn begin(&mut self, _entries: u64) {}

    /// Before any entry but the genesis is checked: what the log's operator says about blobs that are no longer kept.
    fn pruned(&mut self, _pruning: &Pruning) {}

    /// Checks the genesis.
    fn genesis(&mut self, _genesis: &Genesis, _blobs: &Blobs) -> Vec<Finding> {
        Vec::new()
    }

    /// Checks an entry that the rules allow in the state `before`. Long checks may be left to other threads, so the result is findings about
    /// this entry and about entries before it, in order.
    fn entry(
        &mut self,
        _before: &State,
        _index: u64,
        _entry: &Entry,
        _blobs: &Blobs,
    ) -> Vec<Finding> {
        Vec::new()
    }

    /// Waits for the checks that were left to other threads, and returns their findings.
    fn settle(&mut self) -> Vec<Finding> {
        Vec::new()
    }

    /// Whether a later replay may go on from here. Otherwise the replay is not saved, and the file of an earlier one stays: some check could
    /// not be done, and has to be done later. It is asked for after [`Recheck::settle`].
    fn may_be_saved(&self) -> bool {
        true
    }

    /// The state that another process needs to go on from here. It is asked for after [`Recheck::settle`].
    fn save(&self) -> Vec<u8> {
        Vec::new()
    }

    /// Findings about the whole log, at the end.
    fn summary(&mut self) -> Vec<Finding> {
        Vec::new()
    }
}

/// No checks beyond the ledger's own.
impl Recheck for () {}
