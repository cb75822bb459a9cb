//! An outage of the aggregator or of its witnesses moves the open round's deadlines. It costs time, and no node its standing.
//!
//! The ledger shows an outage as a silence: the deadline of the present phase moves by no more than the time since the last entry but votes
//! and the operator's. So an aggregator that claims an outage takes no node's work meanwhile. Governors may vote, because other witnesses may
//! be what ends the outage. The operator may change the log's key, enrol and suspend, because it does so while no aggregator runs. Such an
//! entry neither lengthens nor shortens a move. Only an outage after the draw excuses a node that does not answer: otherwise it could choose
//! among challenges.

use crate::entries::entry::{Body, DeadlinesMoved, Entry};
use crate::rules::state::{Round, State};
use crate::rules::upper_bounds::MAX_ROUND_WINDOW_MS;
use crate::rules::violation::RuleViolation;

/// A shorter outage moves no deadline, unless one passed meanwhile.
pub const LEAST_AWAY_MS: u64 = 60_000;

impl State {
    /// The entry that moves the open round's deadlines at `time_ms` after an outage of `away_ms`; `None` if it may not, or need not.
    pub fn next_move(&self, time_ms: u64, away_ms: u64) -> Option<DeadlinesMoved> {
        let round = self.round.as_ref()?;
        let by_ms = Self::longest_move_ms(round, time_ms).min(away_ms);
        let moved = DeadlinesMoved {
            round: round.number(),
            by_ms,
        };
        self.check_moved(&moved, time_ms).ok()?;
        Some(moved)
    }

    fn longest_move_ms(round: &Round, time_ms: u64) -> u64 {
        let silent_ms = time_ms.saturating_sub(round.silent_since_ms);
        silent_ms.min(MAX_ROUND_WINDOW_MS.saturating_sub(round.moved_ms))
    }

    /// The last moment of the present phase, in Unix milliseconds.
    fn deadline_ms(&self, round: &Round) -> u64 {
        match (&round.closing, &round.randomness) {
            (None, _) => round.opened.commit_deadline_ms,
            (Some(_), Some(randomness)) => randomness.submit_deadline_ms,
            (Some(closing), None) => self.randomness_deadline_ms(round, closing),
        }
    }

    pub(super) fn check_moved(
        &self,
        moved: &DeadlinesMoved,
        time_ms: u64,
    ) -> Result<(), RuleViolation> {
        let round = self.open_round(moved.round)?;
        let undecided = round
            .commits
            .values()
            .any(|commit| commit.decision.is_none());
        if round.closing.is_some() && !undecided {
            return Err(RuleViolation::NoDeadline(moved.round));
        }
        let most_ms = Self::longest_move_ms(round, time_ms);
        if moved.by_ms == 0 || moved.by_ms > most_ms {
            return Err(RuleViolation::MovedTooFar {
                round: moved.round,
                by_ms: moved.by_ms,
                most_ms,
            });
        }
        let deadline_ms = self.deadline_ms(round);
        let passed = round.silent_since_ms <= deadline_ms && deadline_ms < time_ms;
        if moved.by_ms < LEAST_AWAY_MS && !passed {
            return Err(RuleViolation::ShortOutage(moved.round));
        }
        Ok(())
    }

    /// Any entry but a proposal, a vote, or one of the operator ends the open round's silence.
    pub(super) fn end_silence(&mut self, entry: &Entry) {
        let votes = matches!(entry.body, Body::Proposed(_) | Body::Voted(_));
        let operates = matches!(
            entry.body,
            Body::NodeEnrolled(_) | Body::OperatorDecided(_) | Body::LogKeyRotated { .. }
        );
        if let Some(round) = self.round.as_mut().filter(|_| !votes && !operates) {
            round.silent_since_ms = entry.time_ms;
        }
    }

    /// Moves the deadline of the present phase. Closed commitments stay closed.
    pub(super) fn move_deadlines(&mut self, moved: &DeadlinesMoved) {
        let Some(round) = &mut self.round else {
            return;
        };
        round.moved_ms = round.moved_ms.saturating_add(moved.by_ms);
        let deadline = match (&round.closing, &mut round.randomness) {
            (None, _) => &mut round.opened.commit_deadline_ms,
            (Some(_), Some(randomness)) => &mut randomness.submit_deadline_ms,
            // That of the randomness follows from `moved_ms`.
            (Some(_), None) => return,
        };
        *deadline = deadline.saturating_add(moved.by_ms);
    }
}
