//! What a caller checks besides the ledger itself.

use super::report::Finding;
use crate::blobs::Blobs;
use zk0_protocol::{Entry, Genesis, State};

/// What else an auditor checks, entry by entry: proofs, refusals, aggregation. The ledger itself has checked bytes, tree
/// and checkpoint by then. The calls come one after the other, though not all from one thread.
pub trait Recheck: Send {
    /// How many entries there will be.
    fn begin(&mut self, _entries: u64) {}

    /// The founding document.
    fn genesis(&mut self, _genesis: &Genesis, _blobs: &Blobs) -> Vec<Finding> {
        Vec::new()
    }

    /// An entry that the rules allow after `before`. What takes long may be left to other threads: findings are those of this
    /// entry and of entries before it, in order.
    fn entry(
        &mut self,
        _before: &State,
        _index: u64,
        _entry: &Entry,
        _blobs: &Blobs,
    ) -> Vec<Finding> {
        Vec::new()
    }

    /// Waits for what was left to other threads, and gives all findings that are still to come.
    fn settle(&mut self) -> Vec<Finding> {
        Vec::new()
    }

    /// What another process has to know to go on from here. Comes after [`Recheck::settle`].
    fn save(&self) -> Vec<u8> {
        Vec::new()
    }

    /// What there is to say of the whole, at the end.
    fn summary(&mut self) -> Vec<Finding> {
        Vec::new()
    }
}

/// Checks the ledger alone.
impl Recheck for () {}
