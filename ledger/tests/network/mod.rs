//! The network of the protocol's tests, and ledgers on disk to test with.

pub mod long;
pub mod scenario;

pub use zk0_testkit::ledgers::{rounds, shelf};
pub use zk0_testkit::network::*;

use sha2::{Digest, Sha256};
use std::io;
use std::path::Path;
use zk0_files::atomic_file::{self, create_folder};
use zk0_ledger::folder::database;
use zk0_ledger::group::WantedEntry;
use zk0_ledger::{Ledger, LedgerError};
use zk0_protocol::entries::authentic::AuthenticBody;
use zk0_protocol::{Body, Receipt, RuleViolation};

/// Puts an empty database of plain files where the ledger in `dir` has its own. It then goes on with that.
pub fn plain_files(dir: &Path) -> io::Result<()> {
    create_folder(&database(dir))?;
    let none = [&[0; 8][..], &Sha256::digest([0; 8])].concat();
    for (name, content) in [("records", &[][..]), ("ends", &[]), ("size", &none)] {
        atomic_file::replace(&database(dir).join(name), content)?;
    }
    Ok(())
}

/// An entry that somebody wants, if its signatures are valid.
pub fn wanted(time_ms: u64, body: Body) -> Result<WantedEntry, RuleViolation> {
    let body = AuthenticBody::of(body)?;
    Ok(WantedEntry { time_ms, body })
}

/// Appends several entries as one group.
pub trait AppendAll {
    /// Appends the entries, and returns the receipt of each, or why the rules refuse the first one that they refuse.
    fn append_all(&mut self, time_ms: u64, bodies: Vec<Body>) -> Result<Vec<Receipt>, LedgerError>;
}

impl AppendAll for Ledger {
    fn append_all(&mut self, time_ms: u64, bodies: Vec<Body>) -> Result<Vec<Receipt>, LedgerError> {
        let wanted = bodies.into_iter().map(|body| wanted(time_ms, body));
        let outcomes = self.commit(wanted.collect::<Result<_, _>>()?)?;
        let receipt = |outcome: Result<u64, RuleViolation>| self.first_receipt(outcome?);
        outcomes.into_iter().map(receipt).collect()
    }
}
