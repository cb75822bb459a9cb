//! The outcome of a submission: accepted, rejected with a reason on the ledger, or turned away without a record.

use crate::contribution::verify_checked;
use crate::{AuthenticContribution, CheckedClaim, VerifiedContribution, WeightFiles};
use zk0_protocol::entries::authentic::AuthenticBody;
use zk0_protocol::rules::claim_context::VerificationTerms;
use zk0_protocol::{Refusal, RefusalCode};

/// A decision for the ledger.
#[derive(Clone, Debug, PartialEq)]
pub enum DecisionEntry {
    /// The contribution counts.
    Accepted(Box<VerifiedContribution>),
    /// The contribution does not count.
    Rejected(Refusal),
}

impl DecisionEntry {
    /// The body of the decision's entry.
    pub fn body(&self, contribution: &AuthenticContribution) -> AuthenticBody {
        let refused = match self {
            Self::Accepted(_) => None,
            Self::Rejected(reason) => Some(reason.code),
        };
        AuthenticBody::decided(contribution.submission(), refused)
    }
}

/// Decides, by these terms, on a submission whose claim agrees with the ledger.
///
/// # Errors
/// The submission is turned away without a record: the verdict is unknown, or others can cause the fault. The ledger records only
/// what the node itself caused.
pub fn decide(
    checked: &CheckedClaim,
    contribution: &AuthenticContribution,
    weights: &WeightFiles,
    terms: &VerificationTerms,
) -> Result<DecisionEntry, Refusal> {
    match verify_checked(contribution, checked, weights, terms) {
        Ok(verified) => Ok(DecisionEntry::Accepted(Box::new(verified))),
        Err(reason) if reason.code.follows_from_blobs() => Ok(DecisionEntry::Rejected(reason)),
        // The claim agrees with the ledger, so the rules refuse a record with this reason.
        Err(reason) if is_recorded(&reason.code) => Err(RefusalCode::InvalidProof.because(reason)),
        Err(reason) => Err(reason),
    }
}

/// Whether the node that signed for this round caused the refusal itself. The ledger records only that: anybody may resend what a
/// node signed for another round, and would use up its one submission.
pub fn is_recorded(reason: &RefusalCode) -> bool {
    reason.follows_from_ledger() || reason.follows_from_blobs()
}
