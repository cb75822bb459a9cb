//! The checks themselves, each a function of the ledger's statement and the blobs at hand: with the very functions that the
//! aggregator decided by.

use crate::{
    account::{What, Why},
    depth::Depth,
};
use borsh::{BorshDeserialize, BorshSerialize};
use std::fmt::Display;
use zk0_circuits::{claim::dataset::check_leaves, Digest, WeightsDigest};
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_protocol::{
    entries::{
        entry::RoundClosed,
        signed::{DatasetRegistration, Signed, Submission},
    },
    rules::state::State,
    Refusal,
};
use zk0_verifier::{close::close, decide::is_recorded};
use zk0_verifier::{
    verify, verify_claim, Evaluation, UnverifiedContribution, VerifiedContribution,
};

/// The outcome of one check.
#[derive(Debug)]
pub enum Check {
    Passed(What),
    LeftOut(What, Why, String),
    Failed(String),
}

/// A recorded claim, and the state that it was recorded on, as far as it is about that claim.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Recorded {
    pub index: u64,
    pub time_ms: u64,
    pub submission: Signed<Submission>,
    pub before: State,
}

/// What was found out about an accepted contribution.
#[derive(Debug, Default)]
pub struct Examined {
    pub checks: Vec<Check>,
    /// The contribution, if all of it verifies.
    pub verified: Option<VerifiedContribution>,
    /// What verification says against it, if it does.
    pub refused: Option<Refusal>,
    /// The proof, if it is not here.
    pub missing_proof: Option<Digest>,
}

impl Recorded {
    /// Verifies the contribution again, which was accepted.
    pub fn accepted(&self, depth: Depth, blobs: &Blobs) -> Examined {
        let (rules, statement) = (self.before.rules(), &self.submission.statement);
        let node = statement.claim.terms.node;
        let failed = |why: &dyn Display| Examined {
            checks: vec![Check::Failed(format!(
                "the contribution of node {node} was accepted, but {why}"
            ))],
            ..Examined::default()
        };
        let refused = |reason: Refusal| Examined {
            refused: Some(reason.clone()),
            ..failed(&reason)
        };
        let proof = match blobs.get(&statement.proof, rules.max_proof_bytes) {
            Ok(proof) => proof,
            Err(BlobError::Missing(blob)) => {
                return Examined {
                    missing_proof: Some(blob),
                    ..Examined::default()
                }
            }
            Err(error) => return failed(&format!("its proof cannot be read: {error}")),
        };
        let without_update = |why, what: String| match verify_claim(
            &self.submission,
            &proof,
            &self.before,
            self.time_ms,
        ) {
            Ok(()) => Examined {
                checks: vec![
                    Check::Passed(What::Proofs),
                    Check::LeftOut(What::Updates, why, what),
                ],
                ..Examined::default()
            },
            Err(reason) => refused(reason),
        };
        if depth == Depth::Light {
            return without_update(Why::Light, format!("node {node}'s update"));
        }
        let update = match blobs.get(&statement.claim.terms.update.blob, rules.max_update_bytes) {
            Ok(update) => update,
            Err(BlobError::Missing(blob)) => {
                let what =
                    format!("node {node}'s update {blob} is not at hand, its proof verifies");
                return without_update(Why::NotAtHand, what);
            }
            Err(error) => return failed(&format!("its update cannot be read: {error}")),
        };
        let base = match blobs.get(&statement.claim.terms.base.blob, rules.max_base_bytes()) {
            Ok(base) => base,
            Err(error) => return failed(&format!("its base weights cannot be read: {error}")),
        };
        let contribution = UnverifiedContribution {
            submission: self.submission.clone(),
            proof,
            update,
            base,
        };
        match verify(&contribution, &self.before, self.time_ms) {
            Ok(verified) => Examined {
                checks: vec![Check::Passed(What::Proofs), Check::Passed(What::Updates)],
                verified: Some(verified),
                ..Examined::default()
            },
            Err(reason) => refused(reason),
        }
    }

    /// The recorded reason is the one that verification gives.
    pub fn rejected(&self, reason: &Refusal, depth: Depth, blobs: &Blobs) -> Check {
        let (before, time_ms) = (&self.before, self.time_ms);
        let (rules, statement) = (before.rules(), &self.submission.statement);
        let node = statement.claim.terms.node;
        let failed = |found: &dyn Display| {
            Check::Failed(format!(
                "the contribution of node {node} was refused because '{reason}', but {found}"
            ))
        };
        match reason {
            // The ledger's own rules have found these to be right.
            Refusal::Late { .. } | Refusal::Binding { .. } => return Check::Passed(What::Refusals),
            reason if !is_recorded(reason) => {
                return failed(&"that cannot be held against it: others can cause it")
            }
            _ => {}
        }
        let about_update = matches!(
            reason,
            Refusal::MalformedUpdate(_)
                | Refusal::OtherWeights { .. }
                | Refusal::OtherProducts { .. }
                | Refusal::TooFar { .. }
        );
        if about_update && depth == Depth::Light {
            let what = format!("node {node}'s update was refused");
            return Check::LeftOut(What::Refusals, Why::Light, what);
        }
        let proof = match blobs.get(&statement.proof, rules.max_proof_bytes) {
            Ok(proof) => proof,
            Err(BlobError::Missing(blob)) => {
                return not_at_hand(
                    What::Refusals,
                    format!("the refused proof {blob} of node {node}"),
                )
            }
            Err(error) => return failed(&format!("its proof cannot be read: {error}")),
        };
        let found = match about_update {
            // The proof is checked before the update.
            false => verify_claim(&self.submission, &proof, before, time_ms),
            true => {
                let update = match blobs
                    .get(&statement.claim.terms.update.blob, rules.max_update_bytes)
                {
                    Ok(update) => update,
                    Err(BlobError::Missing(blob)) => {
                        return not_at_hand(
                            What::Refusals,
                            format!("the refused update {blob} of node {node}"),
                        )
                    }
                    Err(error) => return failed(&format!("its update cannot be read: {error}")),
                };
                let base = match blobs.get(&statement.claim.terms.base.blob, rules.max_base_bytes())
                {
                    Ok(base) => base,
                    Err(error) => {
                        return failed(&format!("its base weights cannot be read: {error}"))
                    }
                };
                let contribution = UnverifiedContribution {
                    submission: self.submission.clone(),
                    proof,
                    update,
                    base,
                };
                verify(&contribution, before, time_ms).map(drop)
            }
        };
        match found {
            Err(found) if found == *reason => Check::Passed(What::Refusals),
            Err(found) => failed(&format!("verification says: {found}")),
            Ok(()) => failed(&"nothing is wrong with it"),
        }
    }
}

/// The decision of a dispute about entry `contribution` is what verification says; `found` is what it said here, when the
/// contribution was accepted: `None` that it verifies, `Some(None)` that it was not all checked.
pub fn disputed(
    contribution: u64,
    found: Option<&Option<Refusal>>,
    upheld: Option<&Refusal>,
) -> Check {
    let decided = match upheld {
        Some(reason) => format!("upheld because '{reason}'"),
        None => "dismissed".into(),
    };
    let failed = |found: &str| {
        Check::Failed(format!(
            "the dispute of the contribution of entry {contribution} was {decided}, but {found}"
        ))
    };
    match (found, upheld) {
        (None, None) => Check::Passed(What::Disputes),
        (None, Some(_)) => failed("the contribution verifies"),
        (Some(Some(found)), Some(reason)) if found == reason => Check::Passed(What::Disputes),
        (Some(Some(found)), _) => failed(&format!("verification says: {found}")),
        (Some(None), _) => {
            let what =
                format!("the contribution of entry {contribution}, which was not all verified");
            Check::LeftOut(What::Disputes, Why::RestsOnOthers, what)
        }
    }
}

/// A blob that the ledger names is the one at hand.
pub fn whole(what: What, name: &str, blob: &Digest, depth: Depth, blobs: &Blobs) -> Check {
    if depth == Depth::Light {
        return Check::LeftOut(what, Why::Light, format!("{name} {blob}"));
    }
    match blobs.check(blob) {
        Ok(()) => Check::Passed(what),
        Err(BlobError::Missing(blob)) => not_at_hand(what, format!("{name} {blob}")),
        Err(error) => Check::Failed(format!("{name}: {error}")),
    }
}

/// The registered leaves hash to the root, and no two are the same.
pub fn dataset(registration: &DatasetRegistration, depth: Depth, blobs: &Blobs) -> Check {
    let node = registration.node;
    if depth == Depth::Light {
        let what = format!("the leaves of node {node}'s dataset");
        return Check::LeftOut(What::Datasets, Why::Light, what);
    }
    let limit = registration.dataset.samples.saturating_mul(32);
    let bytes = match blobs.get(&registration.leaves, limit) {
        Ok(bytes) => bytes,
        Err(BlobError::Missing(blob)) => {
            return not_at_hand(
                What::Datasets,
                format!("the list {blob} of node {node}'s dataset"),
            )
        }
        Err(error) => return Check::Failed(format!("dataset leaves: {error}")),
    };
    let (leaves, rest) = bytes.as_chunks::<32>();
    let leaves: Vec<_> = leaves.iter().copied().map(Digest).collect();
    match check_leaves(&registration.dataset, &leaves) {
        _ if !rest.is_empty() => Check::Failed("dataset leaves: not whole hashes".into()),
        Ok(()) => Check::Passed(What::Datasets),
        Err(error) => Check::Failed(format!("dataset of node {node}: {error}")),
    }
}

/// The weights that a round starts from, of at most `limit` bytes: the file and its numbers belong together.
pub fn base(
    evaluation: Result<Evaluation, Refusal>,
    limit: u64,
    base: &WeightsDigest,
    depth: Depth,
    blobs: &Blobs,
) -> Check {
    if depth == Depth::Light {
        return Check::LeftOut(
            What::Bases,
            Why::Light,
            format!("base weights {}", base.blob),
        );
    }
    let checked = match blobs.get(&base.blob, limit) {
        Ok(file) => evaluation.and_then(|evaluation| evaluation.check_update(&file, base)),
        Err(BlobError::Missing(blob)) => {
            return not_at_hand(What::Bases, format!("the base weights {blob}"))
        }
        Err(error) => return Check::Failed(format!("base weights: {error}")),
    };
    match checked {
        Ok(_) => Check::Passed(What::Bases),
        Err(error) => Check::Failed(format!("base weights: {error}")),
    }
}

/// The average over the accepted contributions is the one that was recorded.
pub fn average(
    before: &State,
    closed: &RoundClosed,
    contributions: &[VerifiedContribution],
    depth: Depth,
) -> Check {
    let what = || format!("the average of round {}", closed.round);
    if depth == Depth::Light && !before.contributors().is_empty() {
        return Check::LeftOut(What::Averages, Why::Light, what());
    }
    if contributions.len() != before.contributors().len() {
        let why = format!("{}, because not all of its updates were verified", what());
        return Check::LeftOut(What::Averages, Why::RestsOnOthers, why);
    }
    match close(before, contributions) {
        Ok(closing) if closing.closed == *closed => Check::Passed(What::Averages),
        Ok(closing) => Check::Failed(format!(
            "round {} closed with weights {}, but its contributions give {}",
            closed.round,
            show(&closed.global),
            show(&closing.closed.global)
        )),
        Err(error) => Check::Failed(format!(
            "round {} cannot have closed: {error}",
            closed.round
        )),
    }
}

fn not_at_hand(what: What, name: String) -> Check {
    Check::LeftOut(what, Why::NotAtHand, format!("{name} is not at hand"))
}

fn show(weights: &WeightsDigest) -> String {
    format!("{} (quantised {})", weights.blob, weights.quantised)
}
