//! The network of the protocol's tests, and ledgers on disk to test with.

pub mod long;
pub mod scenario;

pub use zk0_testkit::ledgers::{rounds, shelf};
pub use zk0_testkit::network::*;

use zk0_ledger::group::Wanted;
use zk0_ledger::{Ledger, LedgerError};
use zk0_protocol::{Body, Receipt, RuleViolation};

/// Appends several entries as one group.
pub trait AppendAll {
    /// Appends the entries, and returns the receipt of each, or why the rules refuse the first one that they refuse.
    fn append_all(&mut self, time_ms: u64, bodies: Vec<Body>) -> Result<Vec<Receipt>, LedgerError>;
}

impl AppendAll for Ledger {
    fn append_all(&mut self, time_ms: u64, bodies: Vec<Body>) -> Result<Vec<Receipt>, LedgerError> {
        let wanted = bodies.into_iter().map(|body| Wanted::at(time_ms, body));
        let outcomes = self.commit(wanted.collect())?;
        let receipt = |outcome: Result<u64, RuleViolation>| self.first_receipt(outcome?);
        outcomes.into_iter().map(receipt).collect()
    }
}
