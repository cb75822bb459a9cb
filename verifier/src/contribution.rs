//! From what a node sent to what counts: [`verify`] is the only way from one to the other.

use crate::{
    norm::check_norm,
    proof::{check_proof, ProgramKey},
    update::Evaluation,
    weights::{blob_digest, ExpertTensors},
};
use zk0_circuits::{Claim, NodeId};
use zk0_protocol::{
    entries::signed::{Signed, Submission},
    rules::state::State,
    Refusal,
};

/// What a node submitted, nothing of it checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnverifiedContribution {
    /// The signed claim.
    pub submission: Signed<Submission>,
    /// The SP1 compressed proof.
    pub proof: Vec<u8>,
    /// The update: the expert's weights as a safetensors file.
    pub update: Vec<u8>,
    /// The weights that the round started from, likewise.
    pub base: Vec<u8>,
}

/// A contribution that counts: signed by an enrolled node, bound to the ledger, proven, and its weights are those that were
/// proven. Only [`verify`] makes one:
///
/// ```
/// use zk0_verifier::{ExpertTensors, VerifiedContribution};
/// fn read(contribution: &VerifiedContribution) -> (u64, &ExpertTensors) {
///     (contribution.samples(), contribution.weights())
/// }
/// ```
///
/// ```compile_fail
/// use zk0_verifier::{ExpertTensors, VerifiedContribution};
/// fn forge(claim: zk0_circuits::Claim, weights: ExpertTensors) -> VerifiedContribution {
///     VerifiedContribution { claim, samples: 1, weights }
/// }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct VerifiedContribution {
    claim: Claim,
    samples: u64,
    weights: ExpertTensors,
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

    /// Its weight in FedAvg: the committed samples, capped by the rules.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// The contributed weights.
    pub fn weights(&self) -> &ExpertTensors {
        &self.weights
    }
}

/// Verifies a contribution recorded at `time_ms` on top of `state`, cheapest check first: sizes, signature, enrolment, the
/// proof's digest, what the ledger fixes (network, round, commitment, one submission a round, every field of the claim,
/// the deadline), the SP1 proof, the weights and, in mode `checked`, that the products are those with them, and at last how far the
/// weights are from the base.
pub fn verify(
    contribution: &UnverifiedContribution,
    state: &State,
    time_ms: u64,
) -> Result<VerifiedContribution, Refusal> {
    let UnverifiedContribution {
        submission,
        proof,
        update,
        base,
    } = contribution;
    check_size("the update", update, state.rules().max_update_bytes)?;
    verify_claim(submission, proof, state, time_ms)?;
    let claim = submission.statement.claim.clone();
    let evaluation = Evaluation::of(state)?;
    let weights = evaluation.check_update(update, &claim.terms.update)?;
    evaluation.check_products(&claim, base, update)?;
    match state.rules().max_update_norm_bps {
        0 => {}
        limit => check_norm(&evaluation.read(base)?, &weights, limit)?,
    }
    Ok(VerifiedContribution {
        samples: claim
            .terms
            .dataset
            .samples
            .min(state.rules().max_weight_samples),
        claim,
        weights,
    })
}

/// All of [`verify`] but the weights: what can be checked by someone who does not hold the update.
pub fn verify_claim(
    submission: &Signed<Submission>,
    proof: &[u8],
    state: &State,
    time_ms: u64,
) -> Result<(), Refusal> {
    authenticate(submission, proof, state)?;
    let claim = &submission.statement.claim;
    state.check_claim(claim, time_ms)?;
    let key = ProgramKey::from_bytes(&state.genesis().program)
        .map_err(|error| Refusal::InvalidProof(error.to_string()))?;
    check_proof(proof, claim, &key)
}

/// That an enrolled node sent precisely this: claim and proof. Whoever fails here may be a stranger, or someone between the
/// node and us, and nothing that they cause may be held against the node.
pub fn authenticate(
    submission: &Signed<Submission>,
    proof: &[u8],
    state: &State,
) -> Result<(), Refusal> {
    check_size("the proof", proof, state.rules().max_proof_bytes)?;
    let statement = submission
        .verify()
        .map_err(|error| Refusal::Signature(error.to_string()))?;
    let node = statement.claim.terms.node;
    if state.node(&node).is_none() {
        return Err(Refusal::NotEnrolled(node));
    }
    let actual = blob_digest(proof);
    match actual == statement.proof {
        true => Ok(()),
        false => Err(Refusal::ProofDigest {
            signed: statement.proof,
            actual,
        }),
    }
}

fn check_size(what: &str, bytes: &[u8], limit: u64) -> Result<(), Refusal> {
    match bytes.len() as u64 {
        size if size > limit => Err(Refusal::TooLarge {
            what: what.into(),
            size,
            limit,
        }),
        _ => Ok(()),
    }
}
