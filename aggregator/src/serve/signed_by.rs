//! Who signed a request that was answered. Its connection is the signer's from then on.
//!
//! The signature alone does not show that the signer sent the request: statements are public on the ledger, and anybody can send one
//! again, which is answered with the same receipt. So a statement shows who sent it only once: when it is new on the ledger. An upload's
//! signed request is on no ledger.

use crate::connections::caller::Author;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};
use tonic::Response;
use zk0_circuits::NodeId;
use zk0_protocol::tlog::receipt::Receipt;
use zk0_protocol::{Body, Entry};

/// How many entries are remembered. Their receipts were all given out long ago when the oldest is forgotten.
const REMEMBERED: usize = 10_000;

/// The entries whose first receipt has been given out.
#[derive(Clone, Default)]
pub(super) struct Entries(Arc<Mutex<Given>>);

#[derive(Default)]
struct Given {
    /// All entries before this one count as given out.
    first: u64,
    /// Those after it.
    given: BTreeSet<u64>,
}

impl Entries {
    /// Entries before `size` are old.
    pub fn begin_at(&self, size: u64) {
        let mut entries = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        entries.first = entries.first.max(size);
    }

    /// Who signed the entry of this receipt, if this is the first time that the receipt is given out.
    pub fn author(&self, receipt: &Receipt) -> Option<NodeId> {
        self.is_first(receipt.index).then(|| author(receipt))?
    }

    fn is_first(&self, index: u64) -> bool {
        let mut entries = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if index < entries.first || !entries.given.insert(index) {
            return false;
        }
        if entries.given.len() > REMEMBERED {
            if let Some(oldest) = entries.given.pop_first() {
                entries.first = oldest + 1;
            }
        }
        true
    }
}

fn author(receipt: &Receipt) -> Option<NodeId> {
    match Entry::decode(&receipt.entry).ok()?.body {
        Body::DatasetCommitted(signed) => Some(signed.statement.node),
        Body::UpdateCommitted(signed) => Some(signed.statement.node),
        Body::ContributionAccepted(submission) | Body::ContributionRejected { submission, .. } => {
            Some(submission.statement.claim.terms.node)
        }
        Body::KeyRotated { rotation, .. } => Some(rotation.statement.with),
        Body::Proposed(signed) => Some(signed.statement.proposer),
        Body::Voted(signed) => Some(signed.statement.voter),
        Body::Disputed(signed) => Some(signed.statement.disputer),
        _ => None,
    }
}

/// An answer to a request that `author` signed.
pub(super) fn signed_by<T>(author: Option<NodeId>, message: T) -> Response<T> {
    let mut response = Response::new(message);
    if let Some(node) = author {
        response.extensions_mut().insert(Author(node));
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_entry_is_new_once() {
        let entries = Entries::default();
        entries.begin_at(5);
        let first = |index| entries.is_first(index);
        assert_eq!([first(4), first(6), first(5)], [false, true, true]);
        assert_eq!([first(5), first(6)], [false, false]);
        for index in 7..20_000 {
            assert!(first(index));
        }
        assert_eq!([first(4), first(7), first(19_999)], [false; 3]);
    }
}
