//! Deciding a dispute: the contribution is verified again, as it was accepted, on what the ledger was before it.

use crate::round::accepted::Accepted;
use crate::round::request::RequestError;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::log::Ledger;
use zk0_ledger::replay::{replay, Finding, Recheck, Verdict};
use zk0_protocol::entries::entry::Entry;
use zk0_protocol::rules::state::State;
use zk0_protocol::Refusal;

/// What verification says against the contribution that entry `index` accepted; `None` when the contribution verifies. Reads
/// the ledger from its first entry.
pub fn verify_again(ledger: &Ledger, index: u64) -> Result<Option<Refusal>, RequestError> {
    let mut search = Search { index, found: None };
    let report = replay(ledger.dir(), Some(ledger.state().network()), &mut search);
    match search.found {
        Some(accepted) if report.verdict == Verdict::Verified => {
            Ok(accepted.verify(ledger.blobs())?.err())
        }
        _ => Err(RequestError::Internal(format!(
            "entry {index} is disputed, but it cannot be read again from the ledger"
        ))),
    }
}

/// Looks for one acceptance during a replay.
struct Search {
    index: u64,
    found: Option<Accepted>,
}

impl Recheck for Search {
    fn entry(&mut self, before: &State, index: u64, entry: &Entry, _: &Blobs) -> Vec<Finding> {
        if index == self.index {
            self.found = Accepted::of(before, entry);
        }
        Vec::new()
    }
}
