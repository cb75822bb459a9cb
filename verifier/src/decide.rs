//! What becomes of a submission: accepted, rejected with a reason, or turned away without a trace.

use crate::{authenticate, verify, UnverifiedContribution, VerifiedContribution};
use zk0_protocol::{
    entries::entry::{Body, Entry, ENTRY_VERSION},
    rules::{state::State, violation::RuleViolation},
    Refusal,
};

/// A decision that goes on the ledger.
#[derive(Clone, Debug, PartialEq)]
pub enum Decision {
    /// It counts.
    Accepted(Box<VerifiedContribution>),
    /// It does not, for this reason.
    Rejected(Refusal),
}

impl Decision {
    /// The entry's body that records it.
    pub fn body(&self, contribution: &UnverifiedContribution) -> Body {
        let submission = contribution.submission.clone();
        match self {
            Self::Accepted(_) => Body::ContributionAccepted(submission),
            Self::Rejected(reason) => Body::ContributionRejected {
                submission,
                reason: reason.clone(),
            },
        }
    }
}

/// Decides on a submission that arrived at `time_ms`, on top of `state`.
///
/// An error means that it is turned away and leaves no entry: it may come from a stranger, be a replay of what a node
/// signed for another round or network, or carry other bytes than the node signed. If that were recorded, anyone could use
/// up a node's one submission. What is recorded, the node itself has caused.
pub fn decide(
    state: &State,
    contribution: &UnverifiedContribution,
    time_ms: u64,
) -> Result<Decision, Refusal> {
    authenticate(&contribution.submission, &contribution.proof, state)?;
    let reason = match verify(contribution, state, time_ms) {
        Ok(verified) => return Ok(Decision::Accepted(Box::new(verified))),
        Err(reason) => reason,
    };
    if !is_recorded(&reason) {
        return Err(reason);
    }
    let decision = Decision::Rejected(reason);
    let entry = Entry {
        version: ENTRY_VERSION,
        time_ms,
        body: decision.body(contribution),
    };
    match state.check(&entry) {
        Ok(()) => Ok(decision),
        Err(RuleViolation::Refused(refusal)) => Err(refusal),
        Err(violation) => Err(Refusal::InvalidProof(violation.to_string())),
    }
}

/// Whether a refusal is the doing of the node that signed for this round, and so goes on the ledger.
pub fn is_recorded(reason: &Refusal) -> bool {
    match reason {
        Refusal::Late { .. } | Refusal::Binding { .. } => true,
        reason => reason.is_told_by_blobs(),
    }
}
