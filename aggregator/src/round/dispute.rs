//! Deciding a dispute: the contribution is verified again, as it was accepted, on what the ledger was before it.

use crate::round::accepted::Accepted;
use crate::round::request_error::RequestError;
use std::path::PathBuf;
use zk0_circuits::Digest;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::replay::{replay, Finding, Recheck, Verdict};
use zk0_protocol::entries::entry::Entry;
use zk0_protocol::rules::state::State;
use zk0_protocol::Refusal;

/// A dispute about an accepted contribution.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Disputed {
    /// The entry that raised it.
    pub dispute: u64,
    /// The entry that accepted the contribution.
    pub contribution: u64,
    /// The ledger's folder.
    pub dir: PathBuf,
    /// Its blobs.
    pub blobs: Blobs,
    /// The network.
    pub network: Digest,
}

impl Disputed {
    /// What verification says against the contribution; `None` when the contribution verifies. Reads the ledger from its first entry, in a
    /// second view of the database, so that its writer goes on meanwhile.
    pub fn verify_again(&self) -> Result<Option<Refusal>, RequestError> {
        let index = self.contribution;
        let mut search = Search { index, found: None };
        let report = replay(&self.dir, Some(&self.network), &mut search);
        match search.found {
            Some(accepted) if report.verdict == Verdict::Verified => {
                Ok(accepted.verify(&self.blobs)?.err())
            }
            _ => Err(RequestError::Internal(format!(
                "entry {index} is disputed, but it cannot be read again from the ledger"
            ))),
        }
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
