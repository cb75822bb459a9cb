//! What becomes of a submission: it is accepted, it is rejected and the ledger records why, or it is turned away and the ledger
//! records nothing.

use crate::{verify, AuthenticContribution, VerifiedContribution, WeightFiles};
use zk0_protocol::entries::authentic::AuthenticBody;
use zk0_protocol::rules::claim_context::ClaimContext;
use zk0_protocol::rules::violation::RuleViolation;
use zk0_protocol::{Refusal, RefusalCode};

/// A decision that goes on the ledger.
#[derive(Clone, Debug, PartialEq)]
pub enum DecisionEntry {
    /// The contribution counts.
    Accepted(Box<VerifiedContribution>),
    /// The contribution does not count, for this reason.
    Rejected(Refusal),
}

impl DecisionEntry {
    /// The body of the entry that records the decision.
    pub fn body(&self, contribution: &AuthenticContribution) -> AuthenticBody {
        let refused = match self {
            Self::Accepted(_) => None,
            Self::Rejected(reason) => Some(reason.code),
        };
        AuthenticBody::decided(contribution.submission(), refused)
    }
}

/// Decides on a submission that arrived at `time_ms`, in this context.
///
/// # Errors
/// The submission is turned away, and the ledger records nothing. The node signed it, but for another round or network, or the
/// node has submitted before: anybody may send such a submission again. If the ledger recorded that, anybody could use up a
/// node's one submission. The ledger records only what the node itself has caused.
pub fn decide(
    context: &ClaimContext,
    contribution: &AuthenticContribution,
    weights: &WeightFiles,
    time_ms: u64,
) -> Result<DecisionEntry, Refusal> {
    let reason = match verify(contribution, weights, context, time_ms) {
        Ok(verified) => return Ok(DecisionEntry::Accepted(Box::new(verified))),
        Err(reason) => reason,
    };
    if !is_recorded(&reason.code) {
        return Err(reason);
    }
    match context.check_rejected(contribution.claim(), &reason.code, time_ms) {
        Ok(()) => Ok(DecisionEntry::Rejected(reason)),
        Err(RuleViolation::Refused(refusal)) => Err(refusal),
        Err(violation) => Err(RefusalCode::InvalidProof.because(violation)),
    }
}

/// Whether the node that signed for this round caused the refusal itself. Only then does the refusal go on the ledger.
pub fn is_recorded(reason: &RefusalCode) -> bool {
    match reason {
        RefusalCode::Late { .. } | RefusalCode::Binding(_) => true,
        reason => reason.follows_from_blobs(),
    }
}
