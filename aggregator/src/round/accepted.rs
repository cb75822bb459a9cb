//! An accepted contribution, verified again on what the ledger was before it.

use crate::round::request::RequestError;
use zk0_ledger::blobs::Blobs;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::signed::{Signed, Submission};
use zk0_protocol::rules::state::State;
use zk0_protocol::Refusal;
use zk0_verifier::{authenticate, verify, UnverifiedContribution, VerifiedContribution};

/// An acceptance, and what its verification reads of the state that it was made on.
pub struct Accepted {
    submission: Signed<Submission>,
    before: State,
    time_ms: u64,
}

impl Accepted {
    /// The acceptance that `entry` records on top of `before`; `None` if it records something else.
    pub fn of(before: &State, entry: &Entry) -> Option<Self> {
        match &entry.body {
            Body::ContributionAccepted(submission) => Some(Self {
                before: before.for_claims_of(&submission.statement.claim.terms.node),
                time_ms: entry.time_ms,
                submission: submission.clone(),
            }),
            _ => None,
        }
    }

    /// The signed claim.
    pub fn submission(&self) -> &Signed<Submission> {
        &self.submission
    }

    /// What verification says now.
    ///
    /// # Errors
    /// A blob of the contribution cannot be read.
    pub fn verify(
        &self,
        blobs: &Blobs,
    ) -> Result<Result<VerifiedContribution, Refusal>, RequestError> {
        let Self {
            submission,
            before,
            time_ms,
        } = self;
        let read = UnverifiedContribution::read(submission, before.rules(), |digest, limit| {
            blobs.get(digest, limit)
        })?;
        let authentic = authenticate(read.submission, read.proof, before);
        Ok(authentic.and_then(|authentic| verify(&authentic, &read.weights, before, *time_ms)))
    }
}
