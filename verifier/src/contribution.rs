//! From a submission to a contribution that counts: [`authenticate`] makes an [`AuthenticContribution`], [`CheckedClaim::of`]
//! compares its claim with the ledger, and [`verify`] makes a [`VerifiedContribution`] of both. The types let no
//! step be skipped or repeated.

use crate::combine::sealed::Sealed;
use crate::contribution_blobs::{UnverifiedContribution, WeightFiles};
use crate::releases::check_proof_of;
use crate::update::{CheckedUpdate, Evaluation};
use zk0_circuits::{Claim, NodeId};
use zk0_protocol::blob::Blob;
use zk0_protocol::entries::authentic::Authentic;
use zk0_protocol::entries::proof_blob::ProofBlob;
use zk0_protocol::entries::refusal::claim_field::ClaimField;
use zk0_protocol::entries::refusal::code::RoundFile;
use zk0_protocol::entries::signed::{Signed, Submission};
use zk0_protocol::rules::claim_context::{ClaimContext, VerificationTerms};
use zk0_protocol::rules::network_rules::Rules;
use zk0_protocol::{Refusal, RefusalCode};
use zk0_weights::Unread;

/// A submission that an enrolled node signed, with its signed proof. Only [`authenticate`] makes one:
///
/// ```compile_fail
/// use zk0_protocol::{blob::Blob, entries::authentic::Authentic, entries::signed::Submission};
/// fn forge(submission: Authentic<Submission>, proof: Blob<'static>) -> zk0_verifier::AuthenticContribution {
///     zk0_verifier::AuthenticContribution { submission, proof }
/// }
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuthenticContribution {
    submission: Authentic<Submission>,
    proof: Blob<'static>,
}

impl AuthenticContribution {
    /// The signed claim, and the digest of its proof.
    pub fn submission(&self) -> &Authentic<Submission> {
        &self.submission
    }

    /// The claim.
    pub fn claim(&self) -> &Claim {
        &self.submission.statement.claim
    }

    /// The proof's blob. Only its digest is checked.
    pub fn proof(&self) -> &Blob<'static> {
        &self.proof
    }

    /// Checks that the node signed this proof.
    fn of(submission: Authentic<Submission>, proof: Vec<u8>) -> Result<Self, Refusal> {
        let statement = &submission.statement;
        let proof = Blob::of(proof);
        if proof.digest() == statement.proof {
            Ok(Self { submission, proof })
        } else {
            Err(RefusalCode::ProofDigest {
                signed: statement.proof,
                actual: proof.digest(),
            }
            .into())
        }
    }

    fn check_proof(&self, terms: &VerificationTerms) -> Result<(), Refusal> {
        check_proof_of(&terms.program, self.parts()?.sp1, self.claim())
    }

    /// Checks the contribution and its blobs, the cheapest first.
    fn check_blobs(
        &self,
        weights: &WeightFiles,
        terms: &VerificationTerms,
    ) -> Result<(Evaluation, CheckedUpdate), Refusal> {
        let limit = terms.rules.max_update_bytes;
        check_size(RoundFile::Update, &weights.update, limit)?;
        self.check_proof(terms)?;
        let evaluation = Evaluation::of_terms(terms)?;
        let weight_check = self.parts()?.weight_check;
        let update = evaluation.check_weights(self.claim(), weight_check, weights, &terms.rules)?;
        Ok((evaluation, update))
    }

    fn parts(&self) -> Result<ProofBlob<'_>, Refusal> {
        let parts = ProofBlob::split(self.claim(), self.proof.bytes());
        parts.map_err(|error| RefusalCode::MalformedProof.because(error))
    }
}

/// A claim that agrees with the ledger. Only [`CheckedClaim::of`] makes one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckedClaim(Claim);

impl CheckedClaim {
    /// Compares a claim recorded at `time_ms` with the ledger: network, round, commitment, one submission a round, all claimed
    /// fields, the deadline.
    pub fn of(claim: &Claim, context: &ClaimContext, time_ms: u64) -> Result<Self, Refusal> {
        context.check_claim(claim, time_ms)?;
        Ok(Self(claim.clone()))
    }
}

/// A contribution that counts: signed by an enrolled node, bound to the ledger, and proven for exactly its weights. It holds
/// their seal, not the weights ([`crate::combine::sealed`]). Only [`verify`] makes one:
///
/// ```
/// use zk0_verifier::combine::sealed::Sealed;
/// use zk0_verifier::VerifiedContribution;
/// fn read(contribution: &VerifiedContribution) -> (u64, &Sealed) {
///     (contribution.claim().terms.round, contribution.sealed())
/// }
/// ```
///
/// ```compile_fail
/// use zk0_verifier::combine::sealed::Sealed;
/// use zk0_verifier::VerifiedContribution;
/// use zk0_weights::Unread;
/// fn forge(claim: zk0_circuits::Claim, sealed: Sealed, unread: Unread) -> VerifiedContribution {
///     VerifiedContribution { claim, sealed, unread }
/// }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct VerifiedContribution {
    claim: Claim,
    sealed: Sealed,
    unread: Unread,
}

impl VerifiedContribution {
    /// The proven claim.
    pub fn claim(&self) -> &Claim {
        &self.claim
    }

    /// The contributor.
    pub fn node(&self) -> NodeId {
        self.claim.terms.node
    }

    /// The contributed weights, sealed.
    pub fn sealed(&self) -> &Sealed {
        &self.sealed
    }

    /// The base's unread part.
    pub fn unread(&self) -> &Unread {
        &self.unread
    }
}

/// Checks that an enrolled node signed this claim and this proof. A failure is never held against the node: the sender may be a
/// stranger, or someone between the node and the aggregator.
///
/// # Errors
/// The proof exceeds the rules' size, the signature is not the node's, the node is not enrolled, or it signed another proof.
pub fn authenticate(
    submission: Signed<Submission>,
    proof: Vec<u8>,
    context: &ClaimContext,
) -> Result<AuthenticContribution, Refusal> {
    let submission = signed(submission, &proof, context.rules())?;
    let node = submission.statement.claim.terms.node;
    if !context.is_of_enrolled(&node) {
        return Err(RefusalCode::NotEnrolled(node).into());
    }
    AuthenticContribution::of(submission, proof)
}

fn signed(
    submission: Signed<Submission>,
    proof: &[u8],
    rules: &Rules,
) -> Result<Authentic<Submission>, Refusal> {
    check_size(RoundFile::Proof, proof, rules.max_proof_bytes)?;
    Authentic::of(submission).map_err(|error| RefusalCode::Signature.because(error))
}

/// Verifies a contribution recorded at `time_ms` in this context, the cheapest check first: the claim ([`CheckedClaim::of`]), the
/// update's size, the SP1 proof, and the weights ([`Evaluation::check_weights`]).
pub fn verify(
    contribution: &AuthenticContribution,
    weights: &WeightFiles,
    context: &ClaimContext,
    time_ms: u64,
) -> Result<VerifiedContribution, Refusal> {
    let checked = CheckedClaim::of(contribution.claim(), context, time_ms)?;
    verify_checked(contribution, &checked, weights, context.terms())
}

/// [`verify`] after the claim was checked.
pub(crate) fn verify_checked(
    contribution: &AuthenticContribution,
    CheckedClaim(claim): &CheckedClaim,
    weights: &WeightFiles,
    terms: &VerificationTerms,
) -> Result<VerifiedContribution, Refusal> {
    if claim != contribution.claim() {
        let why = "another claim was compared with the ledger";
        return Err(RefusalCode::Binding(ClaimField::Version).because(why));
    }
    let (evaluation, update) = contribution.check_blobs(weights, terms)?;
    Ok(VerifiedContribution {
        sealed: Sealed::of(evaluation.format(), &update.weights),
        unread: update.unread,
        claim: contribution.claim().clone(),
    })
}

/// [`verify`] without the weights, for those who do not hold the update.
pub fn verify_claim(
    contribution: &AuthenticContribution,
    context: &ClaimContext,
    time_ms: u64,
) -> Result<(), Refusal> {
    CheckedClaim::of(contribution.claim(), context, time_ms)?;
    contribution.check_proof(context.terms())
}

/// Verifies an accepted contribution again: what [`authenticate`] and [`verify`] check of it and its blobs. The rules checked the
/// rest when the ledger took the entry.
pub fn verify_accepted(
    accepted: UnverifiedContribution,
    terms: &VerificationTerms,
) -> Result<(), Refusal> {
    let UnverifiedContribution {
        submission,
        proof,
        weights,
    } = accepted;
    let submission = signed(submission, &proof, &terms.rules)?;
    let contribution = AuthenticContribution::of(submission, proof)?;
    contribution.check_blobs(&weights, terms).map(drop)
}

fn check_size(file: RoundFile, bytes: &[u8], limit: u64) -> Result<(), Refusal> {
    match bytes.len() as u64 {
        size if size > limit => Err(RefusalCode::TooLarge { file, size, limit }.into()),
        _ => Ok(()),
    }
}
