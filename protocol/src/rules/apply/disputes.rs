//! Disputes about accepted contributions. An upheld dispute costs the node the contribution's credits and suspends it. The global
//! weights stay, because later rounds were trained from them.

use crate::entries::entry::DisputeResolved;
use crate::entries::member::Standing;
use crate::entries::signed::{Dispute, Evidence};
use crate::rules::state::{OpenDispute, State};
use crate::rules::violation::RuleViolation;
use zk0_circuits::NodeId;

/// Most disputes open at once.
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
                "that entry is not an accepted contribution to a closed round that may still be disputed"
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
            return Err(bad("it was verified again already, and it is valid".into()));
        }
        for open in self.disputes.values() {
            if open.contribution == entry {
                return Err(bad("a dispute about it is open already".into()));
            }
            if open.disputer == disputer {
                return Err(bad(format!(
                    "the disputer has a dispute open already, about entry {}",
                    open.contribution
                )));
            }
        }
        if self.disputes.len() < MAX_OPEN_DISPUTES {
            Ok(())
        } else {
            Err(bad(format!(
                "{MAX_OPEN_DISPUTES} disputes are open already"
            )))
        }
    }

    pub(super) fn governs(&self, key: &NodeId) -> bool {
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

    /// The first dispute for verification to decide. No round opens before that.
    pub fn undecided(&self) -> Option<(u64, OpenDispute)> {
        let mut open = self.disputes.iter();
        let (entry, dispute) = open.find(|(_, one)| one.evidence == Evidence::Verification)?;
        Some((*entry, *dispute))
    }

    /// Refuses to go on while a proposal or a dispute is due.
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
            None => return Err(bad("that entry is not an open dispute".into())),
            Some(open) if open.evidence != Evidence::Verification => {
                return Err(bad("a vote decides about it, not verification".into()))
            }
            Some(_) => {}
        }
        match &resolved.upheld {
            Some(reason) if !reason.follows_from_blobs() => Err(bad(format!(
                "'{reason}' cannot be the result of verifying a claim that the ledger accepted"
            ))),
            _ => Ok(()),
        }
    }

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
            // Only a vote brings the node back, even if it has left or the operator has suspended it.
            if node.standing != Standing::Revoked {
                node.standing = Standing::Suspended;
            }
            self.weigh_anew(&contribution.node);
        }
    }
}
