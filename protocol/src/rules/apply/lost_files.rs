//! Lost files of accepted contributions. The ledger records when the aggregator first requests one from its node. After the
//! length of a submission window, the round may close without the contribution, at the cost of this round's credits only.

use crate::entries::entry::LostContribution;
use crate::rules::state::{Commit, Decision, Round, State};
use crate::rules::violation::RuleViolation;

impl State {
    fn accepted(&self, lost: &LostContribution) -> Result<(&Round, &Commit), RuleViolation> {
        let LostContribution { round, node } = *lost;
        let open = self.open_round(round)?;
        let commit = open.commits.get(&node);
        let accepted =
            commit.filter(|commit| matches!(commit.decision, Some(Decision::Accepted { .. })));
        let accepted = accepted.ok_or(RuleViolation::NotAccepted { round, node })?;
        Ok((open, accepted))
    }

    pub(super) fn check_files_lost(&self, lost: &LostContribution) -> Result<(), RuleViolation> {
        let (open, _) = self.accepted(lost)?;
        if open.lost.contains_key(&lost.node) {
            return Err(RuleViolation::Again {
                round: lost.round,
                what: "the loss of a node's files",
                done: "is recorded",
            });
        }
        Ok(())
    }

    pub(super) fn lose_files(&mut self, lost: &LostContribution, now: u64) {
        if let Some(open) = &mut self.round {
            open.lost.insert(lost.node, now);
        }
    }

    pub(super) fn check_left_out(
        &self,
        lost: &LostContribution,
        time_ms: u64,
    ) -> Result<(), RuleViolation> {
        let LostContribution { round, node } = *lost;
        let (open, _) = self.accepted(lost)?;
        let since = open.lost.get(&node);
        let since_ms = *since.ok_or(RuleViolation::NotAskedFor { round, node })?;
        match self.asked_until_ms(since_ms).checked_sub(time_ms) {
            Some(early_ms) => Err(RuleViolation::LeftOutEarly {
                round,
                node,
                early_ms,
            }),
            None => Ok(()),
        }
    }

    /// When the node's time ends for a file requested at `since_ms`, in Unix milliseconds.
    fn asked_until_ms(&self, since_ms: u64) -> u64 {
        since_ms.saturating_add(self.rules.submit_window_ms)
    }

    /// Whether the open round may close at `time_ms` without this contribution.
    pub fn may_leave_out(&self, lost: &LostContribution, time_ms: u64) -> bool {
        self.check_left_out(lost, time_ms).is_ok()
    }

    /// Moments computed with the contribution no longer count.
    pub(super) fn leave_out(&mut self, lost: &LostContribution) {
        self.decide(&lost.node, Decision::LeftOut);
        if let Some(open) = &mut self.round {
            open.moments = None;
        }
    }
}
