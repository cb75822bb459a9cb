//! The network of the protocol's tests, and ledgers on disk to test with.
#![allow(dead_code)]

pub mod long;
#[path = "../../../protocol/tests/network/mod.rs"]
mod pure;
pub mod rounds;
pub mod scenario;
pub mod shelf;

pub use pure::*;

use zk0_ledger::{Ledger, LedgerError};
use zk0_protocol::{Body, Receipt};

/// Appends several entries as one group.
pub trait AppendAll {
    /// Appends all of the entries or none of them, and returns the receipt of each.
    fn append_all(&mut self, time_ms: u64, bodies: Vec<Body>) -> Result<Vec<Receipt>, LedgerError>;
}

impl AppendAll for Ledger {
    fn append_all(&mut self, time_ms: u64, bodies: Vec<Body>) -> Result<Vec<Receipt>, LedgerError> {
        let appended = self.commit(time_ms, bodies)?;
        appended.map(|index| self.first_receipt(index)).collect()
    }
}
