//! How often a node may commit without a claim that counts. Without a limit, a node would answer only the challenges that suit
//! its update, and a useless update passes once in a while. A refused claim counts like none; otherwise an invalid proof would
//! answer the other challenges.

use borsh::{BorshDeserialize, BorshSerialize};
use serde::{Deserialize, Serialize};

use crate::rules::upper_bounds::MAX_PAUSE_ROUNDS;

/// Most commitments in a record.
pub const MAX_REMEMBERED: u32 = 64;

/// Of a node's last `of_last` commitments, at most `max` may end without an accepted contribution. Beyond that, the node may not
/// commit for `pause_rounds` rounds, and then its record starts empty.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize,
)]
#[serde(deny_unknown_fields)]
pub struct UnansweredRule {
    /// Most commitments without an accepted contribution; equal to `of_last`, no limit.
    pub max: u32,
    /// How many commitments count; 1 to [`MAX_REMEMBERED`].
    pub of_last: u32,
    /// The rounds of the pause; 1 to [`MAX_PAUSE_ROUNDS`].
    pub pause_rounds: u64,
}

impl Default for UnansweredRule {
    /// Four of the last ten, and ten rounds. If an honest node's claims fail one time in ten, it exceeds this in one of 600
    /// sequences of ten rounds.
    fn default() -> Self {
        Self {
            max: 4,
            of_last: 10,
            pause_rounds: 10,
        }
    }
}

impl UnansweredRule {
    /// Checks every value. The error names a bad one.
    pub fn check(&self) -> Result<(), String> {
        if !(1..=MAX_REMEMBERED).contains(&self.of_last) {
            return Err(format!(
                "rule unanswered.of_last is {}; it has to be between 1 and {MAX_REMEMBERED}",
                self.of_last
            ));
        }
        if self.max > self.of_last {
            return Err(format!(
                "rule unanswered.max is {}; it can be at most unanswered.of_last, {}",
                self.max, self.of_last
            ));
        }
        match self.pause_rounds {
            1..=MAX_PAUSE_ROUNDS => Ok(()),
            other => Err(format!(
                "rule unanswered.pause_rounds is {other}; it has to be between 1 and {MAX_PAUSE_ROUNDS}"
            )),
        }
    }
}

/// A node that has not committed in so many rounds in a row, although it might have, is not waited for. It may still commit in time.
pub const AWAITED_ROUNDS: u32 = 3;

/// The outcome of a node's last commitments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct CommitRecord {
    /// One bit for each commitment, the newest lowest; set without an accepted contribution.
    failed: u64,
    /// The first round in which the node may commit again.
    resumes: u64,
    /// In how many rounds in a row the node might have committed and has not.
    idle: u32,
}

impl CommitRecord {
    /// When the node may commit again, if it may not in `round`.
    pub fn paused_until(&self, round: u64) -> Option<u64> {
        (round < self.resumes).then_some(self.resumes)
    }

    /// The commitments under the rule without an accepted contribution.
    pub fn failures(&self, rule: &UnansweredRule) -> u32 {
        let looked_at = match rule.of_last {
            MAX_REMEMBERED.. => u64::MAX,
            fewer => (1 << fewer) - 1,
        };
        (self.failed & looked_at).count_ones()
    }

    /// Whether a round waits for the node's commitment.
    pub fn is_awaited(&self) -> bool {
        self.idle < AWAITED_ROUNDS
    }

    /// Takes a round into account, which is over and in which the node has committed, or might have.
    pub(crate) fn observe_round(&mut self, committed: bool) {
        self.idle = if committed {
            0
        } else {
            self.idle.saturating_add(1)
        };
    }

    /// Adds a commitment of `round`, which is over.
    pub(crate) fn observe(&mut self, rule: &UnansweredRule, round: u64, accepted: bool) {
        self.failed = self.failed << 1 | u64::from(!accepted);
        if self.failures(rule) > rule.max {
            self.failed = 0;
            self.resumes = round.saturating_add(1).saturating_add(rule.pause_rounds);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULE: UnansweredRule = UnansweredRule {
        max: 2,
        of_last: 4,
        pause_rounds: 3,
    };

    fn after(outcomes: &[bool]) -> CommitRecord {
        let mut record = CommitRecord::default();
        for (round, accepted) in (0..).zip(outcomes) {
            record.observe(&RULE, round, *accepted);
        }
        record
    }

    #[test]
    fn a_node_over_the_limit_pauses_and_begins_anew() {
        let record = after(&[false, true, false]);
        assert_eq!((record.failures(&RULE), record.paused_until(3)), (2, None));
        let record = after(&[false, true, false, false]);
        assert_eq!(record.failures(&RULE), 0);
        assert_eq!(record.paused_until(6), Some(7));
        assert_eq!(record.paused_until(7), None);
    }

    #[test]
    fn old_commitments_are_forgotten() {
        assert_eq!(after(&[false, false, true, true, true]).failures(&RULE), 1);
        let record = after(&[false, false, true, true, false, false]);
        assert_eq!((record.failures(&RULE), record.paused_until(6)), (2, None));
    }

    #[test]
    fn every_width_is_possible() {
        for of_last in [1, 63, 64] {
            let rule = UnansweredRule {
                max: of_last,
                of_last,
                pause_rounds: 1,
            };
            rule.check().unwrap();
            let mut record = CommitRecord::default();
            (0..100).for_each(|round| record.observe(&rule, round, false));
            assert_eq!(record.failures(&rule), of_last, "there is no limit");
            assert_eq!(record.paused_until(100), None);
        }
    }

    #[test]
    fn a_rule_that_makes_no_sense_is_refused() {
        let bad = [
            (5, 4, 1),
            (0, 0, 1),
            (1, 65, 1),
            (1, 2, 0),
            (1, 2, MAX_PAUSE_ROUNDS + 1),
        ];
        for (max, of_last, pause_rounds) in bad {
            let rule = UnansweredRule {
                max,
                of_last,
                pause_rounds,
            };
            assert!(rule.check().unwrap_err().starts_with("rule unanswered."));
        }
    }
}
