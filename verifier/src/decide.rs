//! What becomes of a submission: it is accepted, it is rejected and the ledger records why, or it is turned away and the ledger
//! records nothing.

use crate::contribution::verify_checked;
use crate::{AuthenticContribution, CheckedClaim, VerifiedContribution, WeightFiles};
use zk0_protocol::entries::authentic::AuthenticBody;
use zk0_protocol::rules::claim_context::VerificationTerms;
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

/// Decides on a submission whose claim agrees with the ledger, by these terms.
///
/// # Errors
/// The submission is turned away, and the ledger records nothing. Nobody can say whether the contribution counts, or others can cause what is
/// wrong with it. The ledger records only what the node itself has caused.
pub fn decide(
    checked: &CheckedClaim,
    contribution: &AuthenticContribution,
    weights: &WeightFiles,
    terms: &VerificationTerms,
) -> Result<DecisionEntry, Refusal> {
    match verify_checked(contribution, checked, weights, terms) {
        Ok(verified) => Ok(DecisionEntry::Accepted(Box::new(verified))),
        Err(reason) if reason.code.follows_from_blobs() => Ok(DecisionEntry::Rejected(reason)),
        // The ledger finds nothing wrong with the claim, so its rules do not let this reason be recorded.
        Err(reason) if is_recorded(&reason.code) => Err(RefusalCode::InvalidProof.because(reason)),
        Err(reason) => Err(reason),
    }
}

/// Whether the node that signed for this round caused the refusal itself. Only then does the refusal go on the ledger: anybody may send again what
/// a node signed for another round, and would use up its one submission.
pub fn is_recorded(reason: &RefusalCode) -> bool {
    match reason {
        RefusalCode::Late { .. } | RefusalCode::Binding(_) => true,
        reason => reason.follows_from_blobs(),
    }
}
