//! What an auditor checks beyond the ledger's own rules: proofs, refusals, datasets and averages, with the very functions
//! that the aggregator decided by, on the blobs that are at hand.
//!
//! A proof that is missing for an accepted contribution is a fault as soon as its round has closed: nothing counts unproven.
//! Until then it is private, and only its aggregator has it. Weights and evidence that are not at hand (an auditor need not
//! hold them) are reported as not checked.

use crate::{close::close, decide::is_recorded};
use std::fmt::Display;
use zk0_circuits::{dataset::check_leaves, Digest, NodeId, WeightsDigest};
use zk0_ledger::{
    blobs::{BlobError, Blobs},
    entry::{Body, Entry, Genesis, RoundClosed},
    replay::{Finding, Recheck},
    signed::{DatasetRegistration, Signed, Submission},
    state::State,
    Refusal,
};
use zk0_verifier::{
    verify, verify_claim, Evaluation, ProgramKey, UnverifiedContribution, VerifiedContribution,
};

/// Re-verifies contributions and averages during a replay: hand it to [`zk0_ledger::replay::replay`].
#[derive(Debug, Default)]
pub struct Auditor {
    checked: Checked,
    /// Accepted in the open round and verified here.
    contributions: Vec<VerifiedContribution>,
    /// Whether those are all that the round accepted.
    incomplete: bool,
    /// Accepted in the open round without a proof at hand.
    unproven: Vec<(NodeId, Digest)>,
}

/// How much was checked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Checked {
    /// Datasets whose leaves hash to the committed root, all different.
    pub datasets: u64,
    /// Proofs of accepted contributions that verify.
    pub proofs: u64,
    /// Updates whose bytes are the weights that were proven.
    pub updates: u64,
    /// Refusals that were found to be right.
    pub refusals: u64,
    /// Global weights computed anew, with the same digest.
    pub averages: u64,
    /// Checks that were left out because a blob is not at hand.
    pub not_checked: u64,
}

impl Auditor {
    /// How much was checked so far.
    pub fn checked(&self) -> Checked {
        self.checked
    }
}

/// The outcome of one check.
enum Check {
    Passed,
    NotChecked(String),
    Failed(String),
}

impl Recheck for Auditor {
    fn genesis(&mut self, genesis: &Genesis, blobs: &Blobs) -> Vec<Finding> {
        let program = ProgramKey::from_bytes(&genesis.program).map_err(|error| error.to_string());
        let evaluation = Evaluation::of_genesis(genesis).map_err(|error| error.to_string());
        let unusable = [program.map(drop), evaluation.map(drop)]
            .into_iter()
            .filter_map(Result::err)
            .map(Check::Failed);
        let policy = whole("the initial policy", &genesis.policy, blobs);
        let checks = unusable.chain([policy]).collect();
        self.findings(0, checks)
    }

    fn entry(&mut self, before: &State, index: u64, entry: &Entry, blobs: &Blobs) -> Vec<Finding> {
        let checks = match &entry.body {
            Body::DatasetCommitted(signed) => {
                let check = dataset(&signed.statement, blobs);
                count(&mut self.checked.datasets, &check);
                vec![check]
            }
            Body::RoundOpened(opened) => {
                (self.contributions, self.incomplete) = (Vec::new(), false);
                self.unproven.clear();
                vec![base(before, &opened.base, blobs)]
            }
            Body::ContributionAccepted(submission) => {
                self.accepted(before, submission, entry.time_ms, blobs)
            }
            Body::ContributionRejected { submission, reason } => {
                let check = rejected(before, submission, reason, entry.time_ms, blobs);
                count(&mut self.checked.refusals, &check);
                vec![check]
            }
            Body::RoundClosed(closed) => {
                let check = self.closed(before, closed);
                count(&mut self.checked.averages, &check);
                let unproven = self.unproven.drain(..).map(|(node, proof)| {
                    Check::Failed(format!(
                        "the contribution of node {node} was accepted, but its proof {proof} is not there"
                    ))
                });
                let whole = whole("the global weights", &closed.global.blob, blobs);
                unproven.chain([check, whole]).collect()
            }
            Body::Genesis(_)
            | Body::NodeEnrolled(_)
            | Body::UpdateCommitted(_)
            | Body::KeyRotated { .. }
            | Body::Proposed(_)
            | Body::Voted(_)
            | Body::ProposalSettled(_)
            | Body::Disputed(_)
            | Body::DisputeResolved(_) => Vec::new(),
        };
        self.findings(index, checks)
    }
}

impl Auditor {
    fn findings(&mut self, index: u64, checks: Vec<Check>) -> Vec<Finding> {
        let mut findings = Vec::new();
        for check in checks {
            match check {
                Check::Passed => {}
                Check::NotChecked(what) => {
                    self.checked.not_checked += 1;
                    findings.push(Finding::note(index, format!("not checked: {what}")));
                }
                Check::Failed(why) => findings.push(Finding::fault(index, why)),
            }
        }
        findings
    }

    fn accepted(
        &mut self,
        before: &State,
        submission: &Signed<Submission>,
        time_ms: u64,
        blobs: &Blobs,
    ) -> Vec<Check> {
        let (rules, statement) = (before.rules(), &submission.statement);
        let node = statement.claim.node;
        let failed = |why: &dyn Display| {
            vec![Check::Failed(format!(
                "the contribution of node {node} was accepted, but {why}"
            ))]
        };
        self.incomplete = true;
        let proof = match blobs.get(&statement.proof, rules.max_proof_bytes) {
            Ok(proof) => proof,
            Err(BlobError::Missing(blob)) => {
                self.unproven.push((node, blob));
                return vec![Check::NotChecked(format!(
                    "the proof {blob} of node {node}'s accepted contribution is not at hand; it has to be once its round closes"
                ))];
            }
            Err(error) => return failed(&format!("its proof cannot be read: {error}")),
        };
        let update = match blobs.get(&statement.claim.update.blob, rules.max_update_bytes) {
            Ok(update) => update,
            Err(BlobError::Missing(blob)) => {
                return match verify_claim(submission, &proof, before, time_ms) {
                    Ok(()) => {
                        self.checked.proofs += 1;
                        vec![Check::NotChecked(format!(
                            "node {node}'s update {blob} is not at hand, its proof verifies"
                        ))]
                    }
                    Err(reason) => failed(&reason),
                }
            }
            Err(error) => return failed(&format!("its update cannot be read: {error}")),
        };
        let base = match blobs.get(&statement.claim.base.blob, rules.max_base_bytes()) {
            Ok(base) => base,
            Err(error) => return failed(&format!("its base weights cannot be read: {error}")),
        };
        let contribution = UnverifiedContribution {
            submission: submission.clone(),
            proof,
            update,
            base,
        };
        match verify(&contribution, before, time_ms) {
            Ok(verified) => {
                self.checked.proofs += 1;
                self.checked.updates += 1;
                self.contributions.push(verified);
                self.incomplete = self.contributions.len() != before.contributors().len() + 1;
                vec![Check::Passed]
            }
            Err(reason) => failed(&reason),
        }
    }

    fn closed(&mut self, before: &State, closed: &RoundClosed) -> Check {
        let contributions = std::mem::take(&mut self.contributions);
        if std::mem::take(&mut self.incomplete) {
            return Check::NotChecked(format!(
                "the average of round {}, because not all of its updates were verified",
                closed.round
            ));
        }
        match close(before, &contributions) {
            Ok(closing) if closing.closed == *closed => Check::Passed,
            Ok(closing) => Check::Failed(format!(
                "round {} closed with weights {}, but FedAvg over its contributions gives {}",
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
}

fn count(counter: &mut u64, check: &Check) {
    if matches!(check, Check::Passed) {
        *counter += 1;
    }
}

/// A blob that the ledger names is the one at hand.
fn whole(what: &str, blob: &Digest, blobs: &Blobs) -> Check {
    match blobs.check(blob) {
        Ok(()) => Check::Passed,
        Err(BlobError::Missing(blob)) => Check::NotChecked(format!("{what} {blob}: not at hand")),
        Err(error) => Check::Failed(format!("{what}: {error}")),
    }
}

/// The registered leaves hash to the root, and no two are the same.
fn dataset(registration: &DatasetRegistration, blobs: &Blobs) -> Check {
    let limit = registration.dataset.samples.saturating_mul(32);
    let bytes = match blobs.get(&registration.leaves, limit) {
        Ok(bytes) => bytes,
        Err(BlobError::Missing(blob)) => {
            return Check::NotChecked(format!(
                "the leaves {blob} of node {}'s dataset are not at hand",
                registration.node
            ))
        }
        Err(error) => return Check::Failed(format!("dataset leaves: {error}")),
    };
    let (leaves, rest) = bytes.as_chunks::<32>();
    let leaves: Vec<_> = leaves.iter().copied().map(Digest).collect();
    match check_leaves(&registration.dataset, &leaves) {
        _ if !rest.is_empty() => Check::Failed("dataset leaves: not whole hashes".into()),
        Ok(()) => Check::Passed,
        Err(error) => Check::Failed(format!("dataset of node {}: {error}", registration.node)),
    }
}

/// The weights that a round starts from: the file and its numbers belong together.
fn base(before: &State, base: &WeightsDigest, blobs: &Blobs) -> Check {
    let checked = match blobs.get(&base.blob, before.rules().max_base_bytes()) {
        Ok(file) => {
            Evaluation::of(before).and_then(|evaluation| evaluation.check_update(&file, base))
        }
        Err(BlobError::Missing(blob)) => {
            return Check::NotChecked(format!("the base weights {blob} are not at hand"))
        }
        Err(error) => return Check::Failed(format!("base weights: {error}")),
    };
    match checked {
        Ok(_) => Check::Passed,
        Err(error) => Check::Failed(format!("base weights: {error}")),
    }
}

/// The recorded reason is the one that verification gives.
fn rejected(
    before: &State,
    submission: &Signed<Submission>,
    reason: &Refusal,
    time_ms: u64,
    blobs: &Blobs,
) -> Check {
    let (rules, statement) = (before.rules(), &submission.statement);
    let node = statement.claim.node;
    let failed = |found: &dyn Display| {
        Check::Failed(format!(
            "the contribution of node {node} was refused because '{reason}', but {found}"
        ))
    };
    match reason {
        // The ledger's own rules have found these to be right.
        Refusal::Late { .. } | Refusal::Binding { .. } => return Check::Passed,
        reason if !is_recorded(reason) => {
            return failed(&"that cannot be held against it: others can cause it")
        }
        _ => {}
    }
    let proof = match blobs.get(&statement.proof, rules.max_proof_bytes) {
        Ok(proof) => proof,
        Err(BlobError::Missing(blob)) => {
            return Check::NotChecked(format!(
                "the refused proof {blob} of node {node} is not at hand"
            ))
        }
        Err(error) => return failed(&format!("its proof cannot be read: {error}")),
    };
    let about_update = matches!(
        reason,
        Refusal::MalformedUpdate(_) | Refusal::OtherWeights { .. } | Refusal::OtherProducts { .. }
    );
    let found = match blobs.get(&statement.claim.update.blob, rules.max_update_bytes) {
        Err(BlobError::Missing(blob)) if about_update => {
            return Check::NotChecked(format!(
                "the refused update {blob} of node {node} is not at hand"
            ))
        }
        Ok(update) if about_update => {
            let base = match blobs.get(&statement.claim.base.blob, rules.max_base_bytes()) {
                Ok(base) => base,
                Err(error) => return failed(&format!("its base weights cannot be read: {error}")),
            };
            let contribution = UnverifiedContribution {
                submission: submission.clone(),
                proof,
                update,
                base,
            };
            verify(&contribution, before, time_ms).map(drop)
        }
        Err(error) if about_update => {
            return failed(&format!("its update cannot be read: {error}"))
        }
        // The proof is checked before the update.
        _ => verify_claim(submission, &proof, before, time_ms),
    };
    match found {
        Err(found) if found == *reason => Check::Passed,
        Err(found) => failed(&format!("verification says: {found}")),
        Ok(()) => failed(&"nothing is wrong with it"),
    }
}

fn show(weights: &WeightsDigest) -> String {
    format!("{} (quantised {})", weights.blob, weights.quantised)
}
