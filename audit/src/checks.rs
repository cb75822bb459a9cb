//! The checks: functions of the ledger and its blobs, with the aggregator's functions. [`closings`]: a round's end; [`check`]: the
//! outcomes; [`pruning_waiver`]: pruned blobs.

pub mod check;
pub mod closings;
pub mod pruning_waiver;

use crate::account::{CheckKind, SkipReason};
use crate::checks::check::{get, not_at_hand, unreadable};
use crate::checks::pruning_waiver::PruningWaiver;
use crate::depth::Depth;
use crate::trusted_programs::TrustedPrograms;
use borsh::{BorshDeserialize, BorshSerialize};
use std::fmt::Display;
use zk0_circuits::claim::program::{is_carried, verifying_key};
use zk0_circuits::{Digest, EvalSpec, NodeId, WeightsDigest};
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::signed::{DatasetRegistration, Signed, Submission};
use zk0_protocol::rules::claim_context::ClaimContext;
use zk0_protocol::rules::named_blobs::BlobKind;
use zk0_protocol::rules::network_rules::Rules;
use zk0_protocol::{Refusal, RefusalCode};
use zk0_verifier::contribution_blobs::read_proof;
use zk0_verifier::dataset::check_leaf_list;
use zk0_verifier::decide::is_recorded;
use zk0_verifier::{
    authenticate, verify, verify_claim, Evaluation, Unreadable, VerifiedContribution, WeightFiles,
};

pub use crate::checks::check::Check;

/// A recorded claim, and what verification needs of the state before it.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RecordedClaim {
    pub index: u64,
    pub time_ms: u64,
    pub submission: Signed<Submission>,
    pub context: ClaimContext,
}

/// A missing blob of an accepted contribution, withheld while the round is open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing {
    /// The check.
    pub what: CheckKind,
    /// The blob's content.
    pub kind: BlobKind,
    /// The blob.
    pub blob: Digest,
    /// The contribution's entry.
    pub index: u64,
    /// The blob in words.
    pub name: String,
}

/// An audit's result for an accepted contribution.
#[derive(Debug, Default)]
pub struct Examined {
    pub checks: Vec<Check>,
    /// The contribution, if it verifies in full.
    pub verified: Option<VerifiedContribution>,
    /// The refusal, if verification gives one.
    pub refused: Option<RefusalCode>,
    /// A missing proof or update.
    pub missing: Option<Missing>,
}

impl RecordedClaim {
    /// Verifies the accepted contribution again.
    pub fn accepted(&self, depth: Depth, blobs: &Blobs) -> Examined {
        let node = self.node();
        let but =
            |why: &dyn Display| format!("the contribution of node {node} was accepted, but {why}");
        let failed = |why: &dyn Display| Examined {
            checks: vec![Check::Failed(but(why))],
            ..Examined::default()
        };
        let unread = |error: &Unreadable<BlobError>| Examined {
            checks: vec![unreadable(&error.error, but(error))],
            ..Examined::default()
        };
        let missing = |what, Absent { kind, blob }| {
            let name = match kind {
                BlobKind::Weights => format!(
                    "the file {blob} of the base weights of node {node}'s accepted contribution"
                ),
                BlobKind::Proof => {
                    format!("the proof {blob} of node {node}'s accepted contribution")
                }
                _ => format!("the update {blob} of node {node}'s accepted contribution"),
            };
            Some(Missing {
                what,
                kind,
                blob,
                index: self.index,
                name,
            })
        };
        let proof = match self.proof(blobs) {
            Ok(Ok(proof)) => proof,
            Ok(Err(absent)) => {
                return Examined {
                    missing: missing(CheckKind::Proofs, absent),
                    ..Examined::default()
                }
            }
            Err(error) => return unread(&error),
        };
        let weights = match depth {
            Depth::Light => Ok(None),
            Depth::Full => match self.weights(blobs) {
                Ok(weights) => weights.map(Some),
                Err(error) => return unread(&error),
            },
        };
        let verified = match self.verify(proof, weights.as_ref().ok().and_then(Option::as_ref)) {
            Ok(verified) => verified,
            Err(reason) if reason.code == RefusalCode::NoVerifier => {
                let mut checks = vec![self.no_verifier(CheckKind::Proofs, &reason)];
                if depth == Depth::Full {
                    let what = format!("node {node}'s update, because its proof is not checked");
                    checks.push(Check::LeftOut(
                        CheckKind::Updates,
                        SkipReason::RestsOnOthers,
                        what,
                    ));
                }
                return Examined {
                    checks,
                    missing: weights
                        .err()
                        .and_then(|absent| missing(CheckKind::Updates, absent)),
                    ..Examined::default()
                };
            }
            Err(reason) => {
                return Examined {
                    refused: Some(reason.code),
                    ..failed(&reason)
                }
            }
        };
        let mut checks = vec![Check::Passed(CheckKind::Proofs)];
        let missing = match weights {
            Ok(Some(_)) => {
                checks.push(Check::Passed(CheckKind::Updates));
                None
            }
            Ok(None) => {
                let what = format!("node {node}'s update");
                checks.push(Check::LeftOut(CheckKind::Updates, SkipReason::Light, what));
                None
            }
            Err(absent) => missing(CheckKind::Updates, absent),
        };
        Examined {
            checks,
            verified,
            missing,
            ..Examined::default()
        }
    }

    /// Checks that verification gives a refusal's recorded reason.
    pub fn rejected(
        &self,
        reason: &RefusalCode,
        depth: Depth,
        waiver: PruningWaiver,
        blobs: &Blobs,
    ) -> Check {
        let node = self.node();
        let but = |found: &dyn Display| {
            format!("the contribution of node {node} was refused because '{reason}', but {found}")
        };
        let failed = |found: &dyn Display| Check::Failed(but(found));
        let unread = |error: &Unreadable<BlobError>| unreadable(&error.error, but(error));
        match reason {
            // The ledger's rules checked these.
            reason if reason.follows_from_ledger() => return Check::Passed(CheckKind::Refusals),
            reason if !is_recorded(reason) => {
                return failed(&"the node is not to blame for that: others can cause it")
            }
            _ => {}
        }
        let about_update = reason.rests_on_update();
        if about_update && depth == Depth::Light {
            let what = format!("node {node}'s update was refused");
            return Check::LeftOut(CheckKind::Refusals, SkipReason::Light, what);
        }
        let missing = |absent: Absent| {
            let Absent { kind, blob } = absent;
            let what = match kind {
                BlobKind::Weights if !waiver.covers(&kind) => {
                    let why = format!("the file {blob} of the base weights is missing");
                    return Check::Lost(blob, but(&why));
                }
                BlobKind::Weights => {
                    format!("the base weights {blob} of node {node}'s refused update")
                }
                BlobKind::Proof => format!("the refused proof {blob} of node {node}"),
                _ => format!("the refused update {blob} of node {node}"),
            };
            not_at_hand(CheckKind::Refusals, blob, what, waiver.why(&kind))
        };
        let proof = match self.proof(blobs) {
            Ok(Ok(proof)) => proof,
            Ok(Err(proof)) => return missing(proof),
            Err(error) => return unread(&error),
        };
        let weights = match about_update {
            // The proof comes before the update.
            false => None,
            true => match self.weights(blobs) {
                Ok(Ok(weights)) => Some(weights),
                Ok(Err(weights)) => return missing(weights),
                Err(error) => return unread(&error),
            },
        };
        match self.verify(proof, weights.as_ref()) {
            Err(found) if found.code == *reason => Check::Passed(CheckKind::Refusals),
            Err(found) if found.code == RefusalCode::NoVerifier => {
                self.no_verifier(CheckKind::Refusals, &found)
            }
            Err(found) => failed(&format!("verification states: {found}")),
            Ok(_) => failed(&"verification finds nothing wrong with it"),
        }
    }

    fn no_verifier(&self, what: CheckKind, why: &Refusal) -> Check {
        let node = self.node();
        Check::LeftOut(
            what,
            SkipReason::NoVerifier,
            format!("that of node {node}: {why}"),
        )
    }

    fn node(&self) -> NodeId {
        self.submission.statement.claim.terms.node
    }

    fn proof(&self, blobs: &Blobs) -> AtHand<Vec<u8>> {
        let get = |digest: &Digest, limit| get(blobs, digest, limit);
        let proof = read_proof(&self.submission, self.context.rules(), get);
        at_hand(proof)
    }

    fn weights(&self, blobs: &Blobs) -> AtHand<WeightFiles> {
        let terms = &self.submission.statement.claim.terms;
        let get = |digest: &Digest, limit| get(blobs, digest, limit);
        let rules = self.context.rules();
        let weights = WeightFiles::read(&terms.update.blob, &terms.base.blob, rules, get);
        at_hand(weights)
    }

    /// Verifies the contribution, or only its claim without the weights.
    fn verify(
        &self,
        proof: Vec<u8>,
        weights: Option<&WeightFiles>,
    ) -> Result<Option<VerifiedContribution>, Refusal> {
        let (context, time_ms) = (&self.context, self.time_ms);
        let contribution = authenticate(self.submission.clone(), proof, context)?;
        match weights {
            Some(weights) => verify(&contribution, weights, context, time_ms).map(Some),
            None => verify_claim(&contribution, context, time_ms).map(|()| None),
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Absent {
    kind: BlobKind,
    blob: Digest,
}

/// What was read, or the missing blob; an error for all else.
type AtHand<T> = Result<Result<T, Absent>, Unreadable<BlobError>>;

/// The caller decides about a missing blob.
fn at_hand<T>(read: Result<T, Unreadable<BlobError>>) -> AtHand<T> {
    match read {
        Err(Unreadable {
            kind,
            error: BlobError::Missing(blob),
        }) => Ok(Err(Absent { kind, blob })),
        other => other.map(Ok),
    }
}

/// Checks that verification decides a dispute about entry `contribution` as recorded. `found` is this audit's result: `None` if it
/// verifies, `Some(None)` if not all was checked.
pub fn disputed(
    contribution: u64,
    found: Option<&Option<RefusalCode>>,
    upheld: Option<&RefusalCode>,
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
        (None, None) => Check::Passed(CheckKind::Disputes),
        (None, Some(_)) => failed("the contribution verifies"),
        (Some(Some(found)), Some(reason)) if found == reason => Check::Passed(CheckKind::Disputes),
        (Some(Some(found)), _) => failed(&format!("verification states: {found}")),
        (Some(None), _) => {
            let what =
                format!("the contribution of entry {contribution}, which was not all verified");
            Check::LeftOut(CheckKind::Disputes, SkipReason::RestsOnOthers, what)
        }
    }
}

/// Checks that the guest program is this release's, or the auditor's. `key` is the genesis's, or one in force by vote.
pub fn program(genesis: &Genesis, key: &[u8], named: &TrustedPrograms) -> Check {
    if is_carried(genesis.mode, key) || named.programs.contains(key) {
        return Check::Passed(CheckKind::Program);
    }
    let theirs = hex::encode(key);
    Check::Failed(format!(
        "the network's proofs are of the guest program {theirs}; that of this release, in mode {}, is {}, and what another program \
         proves is unknown; if you know that program, repeat the audit with --program {theirs}",
        genesis.mode,
        hex::encode(verifying_key(genesis.mode))
    ))
}

/// Checks that the evaluation's parameters are this release's, or the auditor's.
pub fn evaluation(genesis: &Genesis, named: &TrustedPrograms) -> Check {
    let spec = match EvalSpec::decode(&genesis.evaluation) {
        Ok(spec) => spec,
        Err(error) => return Check::Failed(format!("the evaluation cannot be used: {error}")),
    };
    let (own, digest) = (EvalSpec::new(spec.dims), spec.digest());
    if spec == own || named.evaluations.contains(&digest) {
        return Check::Passed(CheckKind::Evaluation);
    }
    if (&spec.time_frequencies, &spec.rope_frequencies)
        != (&own.time_frequencies, &own.rope_frequencies)
    {
        return Check::Failed(format!(
            "the evaluation {digest} has other frequencies than SmolVLA; if you know it, repeat the audit with --evaluation {digest}"
        ));
    }
    Check::LeftOut(
        CheckKind::Evaluation,
        SkipReason::OthersChoice,
        format!(
            "the founder chose the ranges of the evaluation {digest}; if you have checked them, repeat the audit with --evaluation {digest}"
        ),
    )
}

/// Checks that a blob of this kind is the ledger's.
pub fn whole(
    what: CheckKind,
    kind: &BlobKind,
    name: &str,
    blob: &Digest,
    depth: Depth,
    waiver: PruningWaiver,
    blobs: &Blobs,
) -> Check {
    if depth == Depth::Light {
        return Check::LeftOut(what, SkipReason::Light, format!("{name} {blob}"));
    }
    match blobs.check(blob) {
        Ok(()) => Check::Passed(what),
        Err(BlobError::Missing(blob)) => {
            not_at_hand(what, blob, format!("{name} {blob}"), waiver.why(kind))
        }
        Err(error) => {
            let why = format!("{name} {blob} cannot be checked: {error}");
            unreadable(&error, why)
        }
    }
}

/// Checks that a registration's list has exactly the drawn frames, and that their distinct leaves hash to the root.
pub fn dataset(
    registration: &DatasetRegistration,
    rules: &Rules,
    depth: Depth,
    blobs: &Blobs,
) -> Check {
    let node = registration.node;
    if depth == Depth::Light {
        let what = format!("the drawn frames of node {node}'s dataset");
        return Check::LeftOut(CheckKind::Datasets, SkipReason::Light, what);
    }
    let leaves = BlobKind::Leaves {
        drawn: registration.drawn(),
    };
    let bytes = match get(blobs, &registration.leaves, leaves.max_bytes(rules)) {
        Ok(bytes) => bytes,
        Err(BlobError::Missing(blob)) => {
            return not_at_hand(
                CheckKind::Datasets,
                blob,
                format!("the list {blob} of node {node}'s dataset"),
                SkipReason::NotAtHand,
            )
        }
        Err(error) => {
            let why = format!(
                "the list of drawn frames of node {node}'s dataset cannot be read: {error}"
            );
            return unreadable(&error, why);
        }
    };
    match check_leaf_list(registration, &bytes) {
        Ok(()) => Check::Passed(CheckKind::Datasets),
        Err(error) => Check::Failed(format!("node {node}: {error}")),
    }
}

/// Checks that a round's starting weights file, of at most `limit` bytes, holds the ledger's numbers.
pub fn base(
    evaluation: Result<Evaluation, Refusal>,
    limit: u64,
    base: &WeightsDigest,
    depth: Depth,
    waiver: PruningWaiver,
    blobs: &Blobs,
) -> Check {
    if depth == Depth::Light {
        return Check::LeftOut(
            CheckKind::Bases,
            SkipReason::Light,
            format!("base weights {}", base.blob),
        );
    }
    let checked = match get(blobs, &base.blob, limit) {
        Ok(file) => evaluation.and_then(|evaluation| evaluation.check_update(&file, base)),
        Err(BlobError::Missing(blob)) => {
            let why = waiver.why(&BlobKind::Weights);
            return not_at_hand(
                CheckKind::Bases,
                blob,
                format!("the base weights {blob}"),
                why,
            );
        }
        Err(error) => {
            let why = format!("the base weights cannot be read: {error}");
            return unreadable(&error, why);
        }
    };
    match checked {
        Ok(_) => Check::Passed(CheckKind::Bases),
        Err(error) => Check::Failed(format!("the base weights: {error}")),
    }
}
