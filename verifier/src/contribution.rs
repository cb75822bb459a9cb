//! From what a node sent to what counts: [`authenticate`] makes an [`AuthenticContribution`], [`CheckedClaim::of`] compares its claim with the
//! ledger, and [`verify`] makes a [`VerifiedContribution`] of both. Each step takes what the steps before it made, so that none is left out and
//! none is done twice.

use crate::combine::sealed::Sealed;
use crate::contribution_blobs::WeightFiles;
use crate::releases::check_proof_of;
use crate::update::Evaluation;
use zk0_circuits::{Claim, NodeId};
use zk0_protocol::blob::Blob;
use zk0_protocol::entries::authentic::Authentic;
use zk0_protocol::entries::proof_blob::ProofBlob;
use zk0_protocol::entries::refusal::claim_field::ClaimField;
use zk0_protocol::entries::refusal::code::RoundFile;
use zk0_protocol::entries::signed::{Signed, Submission};
use zk0_protocol::rules::state::State;
use zk0_protocol::{Refusal, RefusalCode};
use zk0_weights::Unread;

/// A submission that an enrolled node signed, with the proof that it signed. Only [`authenticate`] makes one:
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

    /// The blob with the proof. Nothing but its digest is checked.
    pub fn proof(&self) -> &Blob<'static> {
        &self.proof
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
    /// Compares a claim recorded at `time_ms` with what the ledger fixes: network, round, commitment, one submission a round, every field of
    /// the claim, the deadline.
    pub fn of(claim: &Claim, state: &State, time_ms: u64) -> Result<Self, Refusal> {
        state.check_claim(claim, time_ms)?;
        Ok(Self(claim.clone()))
    }
}

/// A contribution that counts: signed by an enrolled node, bound to the ledger, proven, and its weights are those that were
/// proven. It does not hold the weights, but what it takes to recognise them in their file ([`crate::combine::sealed`]). Only
/// [`verify`] makes one:
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
    /// The claim that was proven.
    pub fn claim(&self) -> &Claim {
        &self.claim
    }

    /// Who contributed.
    pub fn node(&self) -> NodeId {
        self.claim.terms.node
    }

    /// The contributed weights, sealed.
    pub fn sealed(&self) -> &Sealed {
        &self.sealed
    }

    /// What the round's base holds where the evaluation does not read.
    pub fn unread(&self) -> &Unread {
        &self.unread
    }
}

/// Checks that an enrolled node sent precisely this: the claim and the proof. Whoever fails here may be a stranger, or someone
/// between the node and the aggregator, so a failure is never held against the node.
///
/// # Errors
/// The proof is larger than the rules allow, the signature is not the node's, the node is not enrolled, or the proof is not the
/// one that the node signed.
pub fn authenticate(
    submission: Signed<Submission>,
    proof: Vec<u8>,
    state: &State,
) -> Result<AuthenticContribution, Refusal> {
    check_size(RoundFile::Proof, &proof, state.rules().max_proof_bytes)?;
    let submission =
        Authentic::of(submission).map_err(|error| RefusalCode::Signature.because(error))?;
    let statement = &submission.statement;
    let node = statement.claim.terms.node;
    if state.node(&node).is_none() {
        return Err(RefusalCode::NotEnrolled(node).into());
    }
    let proof = Blob::of(proof);
    if proof.digest() == statement.proof {
        Ok(AuthenticContribution { submission, proof })
    } else {
        Err(RefusalCode::ProofDigest {
            signed: statement.proof,
            actual: proof.digest(),
        }
        .into())
    }
}

/// Verifies a contribution recorded at `time_ms` on top of `state`, the cheapest check first: what the ledger fixes
/// ([`CheckedClaim::of`]), the size of the update, the SP1 proof, and last the weights ([`Evaluation::check_weights`]).
pub fn verify(
    contribution: &AuthenticContribution,
    weights: &WeightFiles,
    state: &State,
    time_ms: u64,
) -> Result<VerifiedContribution, Refusal> {
    let checked = CheckedClaim::of(contribution.claim(), state, time_ms)?;
    verify_checked(contribution, &checked, weights, state)
}

/// [`verify`] of a contribution whose claim was compared with the ledger before.
pub(crate) fn verify_checked(
    contribution: &AuthenticContribution,
    checked: &CheckedClaim,
    weights: &WeightFiles,
    state: &State,
) -> Result<VerifiedContribution, Refusal> {
    let CheckedClaim(claim) = checked;
    if claim != contribution.claim() {
        let why = "another claim was compared with the ledger";
        return Err(RefusalCode::Binding(ClaimField::Version).because(why));
    }
    let rules = state.rules();
    check_size(RoundFile::Update, &weights.update, rules.max_update_bytes)?;
    check_proven(contribution, state)?;
    let evaluation = Evaluation::of(state)?;
    let weight_check = contribution.parts()?.weight_check;
    let update = evaluation.check_weights(claim, weight_check, weights, rules)?;
    Ok(VerifiedContribution {
        sealed: Sealed::of(evaluation.format(), &update.weights),
        unread: update.unread,
        claim: claim.clone(),
    })
}

/// All of [`verify`] but the weights: what somebody who does not hold the update can check.
pub fn verify_claim(
    contribution: &AuthenticContribution,
    state: &State,
    time_ms: u64,
) -> Result<(), Refusal> {
    CheckedClaim::of(contribution.claim(), state, time_ms)?;
    check_proven(contribution, state)
}

fn check_proven(contribution: &AuthenticContribution, state: &State) -> Result<(), Refusal> {
    let claim = contribution.claim();
    check_proof_of(state.program(), contribution.parts()?.sp1, claim)
}

fn check_size(file: RoundFile, bytes: &[u8], limit: u64) -> Result<(), Refusal> {
    match bytes.len() as u64 {
        size if size > limit => Err(RefusalCode::TooLarge { file, size, limit }.into()),
        _ => Ok(()),
    }
}
