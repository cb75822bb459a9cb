//! Which blobs anyone may read: an update or a proof stays private until its round has closed, so that nobody can copy it
//! in the round it is for.

use std::collections::BTreeSet;
use zk0_circuits::Digest;
use zk0_ledger::entry::Body;

/// Whether a blob may be handed out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// To anyone.
    Public,
    /// Not before the open round has closed.
    HeldBack,
    /// The ledger names no such blob.
    Unknown,
}

/// The blobs that the ledger names, as a fold over its entries.
#[derive(Clone, Debug, Default)]
pub struct Disclosed {
    public: BTreeSet<Digest>,
    held_back: BTreeSet<Digest>,
}

impl Disclosed {
    /// Takes note of an entry.
    pub fn observe(&mut self, body: &Body) {
        match body {
            Body::Genesis(genesis) => self.public.extend([genesis.policy, genesis.initial.blob]),
            Body::DatasetCommitted(signed) => self.public.extend([signed.statement.leaves]),
            Body::UpdateCommitted(signed) => self.hold_back(signed.statement.update.blob),
            Body::ContributionAccepted(submission)
            | Body::ContributionRejected { submission, .. } => {
                self.hold_back(submission.statement.proof);
            }
            Body::RoundClosed(closed) => {
                self.public.append(&mut self.held_back);
                self.public.insert(closed.global.blob);
            }
            Body::NodeEnrolled(_)
            | Body::RoundOpened(_)
            | Body::KeyRotated { .. }
            | Body::Proposed(_)
            | Body::Voted(_)
            | Body::ProposalSettled(_)
            | Body::Disputed(_)
            | Body::DisputeResolved(_) => {}
        }
    }

    /// Whether `blob` may be handed out now.
    pub fn access(&self, blob: &Digest) -> Access {
        if self.public.contains(blob) {
            Access::Public
        } else if self.held_back.contains(blob) {
            Access::HeldBack
        } else {
            Access::Unknown
        }
    }

    /// All blobs that anyone may read.
    pub fn public(&self) -> impl Iterator<Item = &Digest> {
        self.public.iter()
    }

    fn hold_back(&mut self, blob: Digest) {
        self.held_back.insert(blob);
    }
}
