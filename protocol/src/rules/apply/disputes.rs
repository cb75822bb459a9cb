//! Disputes: an accepted contribution is said to be false. Where it is, its credits are taken back and its node is suspended.
//!
//! The global weights stay as they are: later rounds were trained from them.

use crate::{
    entries::{
        entry::DisputeResolved,
        refusal::Refusal,
        signed::{Dispute, Evidence},
    },
    rules::{
        state::{OpenDispute, Standing, State},
        violation::RuleViolation,
    },
};
use zk0_circuits::NodeId;

/// Disputes that may be open at once.
pub const MAX_OPEN_DISPUTES: usize = 256;

impl State {
    pub(super) fn check_dispute(&self, dispute: &Dispute, now: u64) -> Result<(), RuleViolation> {
        self.check_network(&dispute.network)?;
        let (disputer, entry) = (dispute.disputer, dispute.contribution);
        if !self.governs(&disputer) {
            self.active(&disputer)?;
        }
        let bad = |why: String| RuleViolation::BadDispute { entry, why };
        let Some(contribution) = self.contributions.get(&entry) else {
            return Err(bad(
                "it is no accepted contribution to a closed round that may still be disputed"
                    .into(),
            ));
        };
        if now > contribution.disputable_until_ms {
            return Err(bad(format!(
                "it could be disputed until {} ms ago",
                now - contribution.disputable_until_ms
            )));
        }
        if dispute.evidence == Evidence::Verification && contribution.verified_again {
            return Err(bad("it was verified again already, and it holds".into()));
        }
        for open in self.disputes.values() {
            if open.contribution == entry {
                return Err(bad("a dispute about it is open already".into()));
            }
            if open.disputer == disputer {
                return Err(bad(format!(
                    "who disputes it has a dispute open already, about entry {}",
                    open.contribution
                )));
            }
        }
        match self.disputes.len() < MAX_OPEN_DISPUTES {
            true => Ok(()),
            false => Err(bad(format!(
                "{MAX_OPEN_DISPUTES} disputes are open already"
            ))),
        }
    }

    fn governs(&self, key: &NodeId) -> bool {
        let governors = &self.rules.governance.governors;
        governors.iter().any(|governor| governor.key == *key)
    }

    pub(super) fn dispute(&mut self, dispute: &Dispute, index: u64, now: u64) {
        let window = self.rules.credits.dispute_window_ms;
        self.disputes.insert(
            index,
            OpenDispute {
                disputer: dispute.disputer,
                contribution: dispute.contribution,
                evidence: dispute.evidence,
                lapses_ms: now.saturating_add(window),
            },
        );
    }

    /// The first dispute that verification has to decide: no round opens before it has.
    pub fn undecided(&self) -> Option<(u64, OpenDispute)> {
        let mut open = self.disputes.iter();
        let (entry, dispute) = open.find(|(_, one)| one.evidence == Evidence::Verification)?;
        Some((*entry, *dispute))
    }

    /// Refuses while a proposal or a dispute waits for an end that only the aggregator can record.
    pub(super) fn check_nothing_due(&self, now: u64) -> Result<(), RuleViolation> {
        if let Some(number) = self.due(now) {
            return Err(RuleViolation::ProposalDue(number));
        }
        match self.undecided() {
            Some((entry, _)) => Err(RuleViolation::DisputeUndecided(entry)),
            None => Ok(()),
        }
    }

    pub(super) fn check_resolved(&self, resolved: &DisputeResolved) -> Result<(), RuleViolation> {
        let bad = |why: String| RuleViolation::BadDispute {
            entry: resolved.dispute,
            why,
        };
        if let Some(round) = &self.round {
            return Err(RuleViolation::RoundStillOpen(round.number()));
        }
        match self.disputes.get(&resolved.dispute) {
            None => return Err(bad("it is no open dispute".into())),
            Some(open) if open.evidence != Evidence::Verification => {
                return Err(bad("a vote decides about it, not verification".into()))
            }
            Some(_) => {}
        }
        match &resolved.upheld {
            Some(reason) if !reason.is_told_by_blobs() => Err(bad(format!(
                "verification of a claim that the ledger accepted cannot say '{reason}'"
            ))),
            _ => Ok(()),
        }
    }

    /// The end of a dispute, whoever decided it.
    pub(super) fn judge(&mut self, dispute: u64, upheld: bool) {
        let Some(open) = self.disputes.remove(&dispute) else {
            return;
        };
        if !upheld {
            if let Some(contribution) = self.contributions.get_mut(&open.contribution) {
                contribution.verified_again |= open.evidence == Evidence::Verification;
            }
            return;
        }
        let Some(contribution) = self.contributions.remove(&open.contribution) else {
            return;
        };
        if let Some(node) = self.nodes.get_mut(&contribution.node) {
            node.credits = node.credits.saturating_sub(contribution.credits);
            if node.standing == Standing::Active {
                node.standing = Standing::Suspended;
            }
            self.weigh_anew(&contribution.node);
        }
    }
}

impl Refusal {
    /// Whether a refusal follows from the proof and the weights, which are beside the ledger: whoever holds them repeats the
    /// check. The others follow from the ledger itself, or concern bytes that never get as far as the ledger.
    pub fn is_told_by_blobs(&self) -> bool {
        match self {
            Self::MalformedProof(_)
            | Self::OtherClaim
            | Self::OtherProgram
            | Self::InvalidProof(_)
            | Self::MalformedUpdate(_)
            | Self::OtherWeights { .. }
            | Self::OtherProducts { .. }
            | Self::TooFar { .. } => true,
            Self::TooLarge { .. }
            | Self::Signature(_)
            | Self::NotEnrolled(_)
            | Self::WrongNetwork { .. }
            | Self::WrongRound { .. }
            | Self::Late { .. }
            | Self::Duplicate { .. }
            | Self::CopiedUpdate { .. }
            | Self::NotCommitted(_)
            | Self::Binding { .. }
            | Self::Dataset(_)
            | Self::ProofDigest { .. }
            | Self::UpdateDigest { .. }
            | Self::MissingUpdate(_)
            | Self::NotActive { .. }
            | Self::NotInvited { .. }
            | Self::RoundFull { .. } => false,
        }
    }
}
