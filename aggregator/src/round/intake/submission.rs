//! Decides on a submission, cheapest check first. Only the first and the last step need the aggregator:
//!
//! 1. [`Aggregator::begin_submission`] compares the claim with the ledger. It turns away what an earlier round decided, before a proof is
//!    hashed or a signature is verified.
//! 2. [`PendingSubmission::authenticate`] checks that the node signed this claim and this proof.
//! 3. [`PendingSubmission::judge`] reads the weights, and verifies the SP1 proof and the weights.
//! 4. [`VerifiedSubmission::keep`] keeps the proof.
//! 5. [`crate::round::intake::group`] records the decision, for which the ledger's rules compare the claim once more.

use crate::round::aggregator::Aggregator;
use crate::round::intake::admission::Comparison;
use crate::round::request_error::RequestError;
use zk0_circuits::{Claim, Digest};
use zk0_ledger::blobs::Blobs;
use zk0_protocol::entries::authentic::{Authentic, AuthenticBody};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::signed::{Signed, Submission};
use zk0_protocol::rules::claim_context::ClaimContext;
use zk0_protocol::tlog::receipt::Receipt;
use zk0_protocol::{Refusal, RefusalCode};
use zk0_verifier::decide::{decide, is_recorded, DecisionEntry};
use zk0_verifier::{authenticate, AuthenticContribution, CheckedClaim, WeightFiles};

/// The answer to a submission.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SubmissionAnswer {
    /// Why the contribution does not count; `None` if it counts.
    pub rejected: Option<Refusal>,
    /// The receipt of the decision's entry.
    pub receipt: Receipt,
}

impl SubmissionAnswer {
    /// The answer of this entry, if it decides on `submission`.
    pub fn of(submission: &Signed<Submission>, receipt: Receipt, body: Body) -> Option<Self> {
        let (recorded, rejected) = match body {
            Body::ContributionAccepted(recorded) => (recorded, None),
            Body::ContributionRejected { submission, reason } => (submission, Some(reason.into())),
            _ => return None,
        };
        (recorded == *submission).then_some(Self { rejected, receipt })
    }
}

/// What a submission is judged by.
pub struct PendingSubmission {
    /// The claim that agrees with the ledger, or the refusal that the ledger records.
    claim: Result<CheckedClaim, Refusal>,
    /// The ledger's part about the node's claims.
    context: ClaimContext,
    /// The committed update, and the round's first weights, by the ledger: a claim may name other blobs.
    weights: [Digest; 2],
    blobs: Blobs,
}

/// A decision whose proof is not kept yet.
pub struct VerifiedSubmission {
    judged: DecidedSubmission,
    blobs: Blobs,
}

/// A decision to be recorded. Its proof is kept.
pub struct DecidedSubmission {
    contribution: AuthenticContribution,
    decision: DecisionEntry,
}

impl Aggregator {
    /// First step for a submission that arrived at `arrived_ms`.
    pub fn begin_submission(
        &self,
        submission: &Signed<Submission>,
        arrived_ms: u64,
    ) -> Comparison<PendingSubmission> {
        let claim = &submission.statement.claim;
        Comparison {
            // After a lost answer, perhaps in a later round.
            earlier: self.index.decision(&claim.terms.node),
            published_key: self.published_key(),
            allowed: self.pending(claim, arrived_ms),
        }
    }

    /// # Errors
    /// The claim is for another network or round; or the node is not enrolled, has not committed or has submitted something else. That is
    /// not recorded, because others may repeat what a node once signed.
    fn pending(&self, claim: &Claim, arrived_ms: u64) -> Result<PendingSubmission, RequestError> {
        let (state, node) = (self.state(), claim.terms.node);
        let context = state.claim_context(&node);
        let claim = match CheckedClaim::of(claim, &context, self.ledger.time_ms(arrived_ms)) {
            Err(reason) if !is_recorded(&reason.code) => return Err(reason.into()),
            // The node's own faults are recorded, once its signature is verified.
            compared => compared,
        };
        let not_committed = || Refusal::from(RefusalCode::NotCommitted(node));
        let round = state.round().ok_or_else(not_committed)?;
        let commit = round.commits.get(&node).ok_or_else(not_committed)?;
        Ok(PendingSubmission {
            claim,
            weights: [commit.update.blob, round.opened.base.blob],
            context,
            blobs: self.ledger.blobs().clone(),
        })
    }
}

impl PendingSubmission {
    /// Checks that an enrolled node signed this claim and this proof.
    pub fn authenticate(
        self,
        submission: Signed<Submission>,
        proof: Vec<u8>,
    ) -> Result<(Self, AuthenticContribution), RequestError> {
        let contribution = authenticate(submission, proof, &self.context)?;
        Ok((self, contribution))
    }

    /// Reads weights from the store that the ledger's folder lacks.
    pub fn with_weights_at_hand(self) -> Result<Self, RequestError> {
        for blob in &self.weights {
            if self.blobs.contains(blob) {
                self.blobs.fetch(blob)?;
            }
        }
        Ok(self)
    }

    /// Decides on the contribution. Reads the weights only if the claim agrees with the ledger.
    pub fn judge(
        self,
        contribution: AuthenticContribution,
    ) -> Result<VerifiedSubmission, RequestError> {
        let decision = match &self.claim {
            Ok(claim) => self.verify(claim, &contribution)?,
            Err(reason) => DecisionEntry::Rejected(reason.clone()),
        };
        Ok(VerifiedSubmission {
            judged: DecidedSubmission {
                contribution,
                decision,
            },
            blobs: self.blobs,
        })
    }

    fn verify(
        &self,
        claim: &CheckedClaim,
        contribution: &AuthenticContribution,
    ) -> Result<DecisionEntry, RequestError> {
        let [update, base] = &self.weights;
        let get = |digest: &Digest, limit| self.blobs.get(digest, limit);
        let weights = WeightFiles::read(update, base, self.context.rules(), get)?;
        Ok(decide(claim, contribution, &weights, self.context.terms())?)
    }
}

impl VerifiedSubmission {
    /// Keeps the proof among the ledger's blobs.
    pub fn keep(self) -> Result<DecidedSubmission, RequestError> {
        self.blobs.put(self.judged.contribution.proof())?;
        Ok(self.judged)
    }
}

impl DecidedSubmission {
    /// Why the contribution does not count; `None` if it counts.
    pub fn rejected(&self) -> Option<&Refusal> {
        match &self.decision {
            DecisionEntry::Accepted(_) => None,
            DecisionEntry::Rejected(reason) => Some(reason),
        }
    }

    pub(super) fn body(&self) -> AuthenticBody {
        self.decision.body(&self.contribution)
    }

    /// The submission, whose signature is verified.
    pub(super) fn submission(&self) -> &Authentic<Submission> {
        self.contribution.submission()
    }

    pub(super) fn decision(self) -> DecisionEntry {
        self.decision
    }
}
