//! What the ledger fixes about a claim before anyone looks at its proof.

use crate::{
    entries::refusal::Refusal,
    rules::{
        network_rules::Disclosure,
        state::{Commit, Round, State},
    },
};
use std::fmt::Display;
use zk0_circuits::{
    Claim, DatasetCommitment, Digest, Losses, NodeId, WeightsDigest, CLAIM_VERSION,
};

/// Every field of a claim that the ledger fixes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExpectedClaim {
    pub network: Digest,
    pub round: u64,
    pub node: NodeId,
    pub dataset: DatasetCommitment,
    pub evaluation: Digest,
    pub base: WeightsDigest,
    pub update: WeightsDigest,
    pub challenge: Digest,
    pub eval_samples: u32,
    pub min_improvement_bps: u32,
    pub disclosure: Disclosure,
}

impl ExpectedClaim {
    /// The claim that says so, with these losses.
    pub fn with(&self, losses: Losses) -> Claim {
        Claim {
            version: CLAIM_VERSION,
            network: self.network,
            round: self.round,
            node: self.node,
            dataset: self.dataset,
            evaluation: self.evaluation,
            base: self.base,
            update: self.update,
            challenge: self.challenge,
            eval_samples: self.eval_samples,
            min_improvement_bps: self.min_improvement_bps,
            losses,
            weight_check: None,
        }
    }
}

impl State {
    /// What the claim of `node` in the open round has to say.
    pub fn expected_claim(&self, node: &NodeId) -> Result<ExpectedClaim, Refusal> {
        let (round, commit) = self.commit(node)?;
        let rules = self.rules();
        Ok(ExpectedClaim {
            network: self.network,
            round: round.number(),
            node: *node,
            dataset: commit.dataset,
            evaluation: round.opened.evaluation,
            base: round.opened.base,
            update: commit.update,
            challenge: commit.challenge,
            eval_samples: rules.eval_samples,
            min_improvement_bps: rules.min_improvement_bps,
            disclosure: rules.disclosure,
        })
    }

    /// Compares a claim with what the ledger fixes: network, round, enrolment, commitment, one submission a round, then
    /// field by field.
    pub fn check_bindings(&self, claim: &Claim) -> Result<(), Refusal> {
        same("version", claim.version, CLAIM_VERSION)?;
        self.check_addressed(&claim.network, claim.round, &claim.node)?;
        let (_, commit) = self.commit(&claim.node)?;
        if commit.decision.is_some() {
            return Err(already_submitted(claim));
        }
        let expected = self.expected_claim(&claim.node)?;
        let (ours, theirs) = (&expected.dataset, &claim.dataset);
        same("dataset.root", theirs.root, ours.root)?;
        same("dataset.samples", theirs.samples, ours.samples)?;
        same(
            "dataset.feature_spec",
            theirs.feature_spec,
            ours.feature_spec,
        )?;
        same(
            "dataset.salt_commitment",
            theirs.salt_commitment,
            ours.salt_commitment,
        )?;
        same("evaluation", claim.evaluation, expected.evaluation)?;
        same("base.blob", claim.base.blob, expected.base.blob)?;
        same(
            "base.quantised",
            claim.base.quantised,
            expected.base.quantised,
        )?;
        same("update.blob", claim.update.blob, expected.update.blob)?;
        same(
            "update.quantised",
            claim.update.quantised,
            expected.update.quantised,
        )?;
        same("challenge", claim.challenge, expected.challenge)?;
        same("eval_samples", claim.eval_samples, expected.eval_samples)?;
        same(
            "min_improvement_bps",
            claim.min_improvement_bps,
            expected.min_improvement_bps,
        )?;
        let disclosed = match claim.losses {
            Losses::Hidden => Disclosure::Nothing,
            Losses::Disclosed { .. } => Disclosure::Losses,
        };
        same("disclosure", disclosed, expected.disclosure)
    }

    /// [`State::check_bindings`], and that the claim is in time when it is recorded at `time_ms`.
    pub fn check_claim(&self, claim: &Claim, time_ms: u64) -> Result<(), Refusal> {
        self.check_bindings(claim)?;
        match &self.round {
            Some(round) => in_time("the claim", round, time_ms, round.opened.submit_deadline_ms),
            None => Ok(()),
        }
    }

    /// For this network, for the open round, and from an enrolled node.
    pub(crate) fn check_addressed(
        &self,
        network: &Digest,
        round: u64,
        node: &NodeId,
    ) -> Result<&Round, Refusal> {
        if *network != self.network {
            return Err(Refusal::WrongNetwork {
                claimed: *network,
                ours: self.network,
            });
        }
        let open = match &self.round {
            Some(open) if open.number() == round => open,
            other => {
                return Err(Refusal::WrongRound {
                    claimed: round,
                    open: other.as_ref().map(Round::number),
                })
            }
        };
        self.active(node)?;
        Ok(open)
    }

    fn commit(&self, node: &NodeId) -> Result<(&Round, &Commit), Refusal> {
        self.round
            .as_ref()
            .and_then(|round| Some((round, round.commits.get(node)?)))
            .ok_or(Refusal::NotCommitted(*node))
    }
}

pub(crate) fn already_submitted(claim: &Claim) -> Refusal {
    Refusal::Duplicate {
        node: claim.node,
        round: claim.round,
        done: "submitted a contribution".into(),
    }
}

/// Refuses what is recorded after its deadline.
pub(crate) fn in_time(
    what: &str,
    round: &Round,
    time_ms: u64,
    deadline_ms: u64,
) -> Result<(), Refusal> {
    match time_ms.saturating_sub(deadline_ms) {
        0 => Ok(()),
        late_ms => Err(Refusal::Late {
            what: what.into(),
            round: round.number(),
            late_ms,
        }),
    }
}

pub(crate) fn same<T: PartialEq + Display>(
    field: &str,
    claimed: T,
    expected: T,
) -> Result<(), Refusal> {
    match claimed == expected {
        true => Ok(()),
        false => Err(Refusal::Binding {
            field: field.into(),
            claimed: claimed.to_string(),
            expected: expected.to_string(),
        }),
    }
}
