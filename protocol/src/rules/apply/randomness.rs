//! The closing of a round's commitments, and the randomness of its challenges.
//!
//! A challenge must not depend on anything that a node or the aggregator can vary once it knows the rest. So a rule closes the
//! commitments, which fixes all that the source depends on, before the randomness is drawn.

use crate::challenge::closing::{commitments, CommitmentsClosing};
use crate::challenge::drawing::DrawContext;
use crate::entries::entry::{CommitmentsClosed, RandomnessDrawn};
use crate::rules::state::{Node, Randomness, Round, State};
use crate::rules::upper_bounds::MAX_COMMITS;
use crate::rules::violation::RuleViolation;
use zk0_circuits::{Digest, NodeId};

impl State {
    /// The entry that closes the commitments of the open round, if they may close at `time_ms`: when their deadline is over, and
    /// earlier once every node that may commit has committed. Once one has committed, nodes that were idle lately are not waited for.
    pub fn next_commitments_closed(&self, time_ms: u64) -> Option<CommitmentsClosed> {
        let round = self.round.as_ref()?;
        let closed = CommitmentsClosed {
            round: round.number(),
            commitments: self.commitments(round),
        };
        self.check_commitments_closed(&closed, time_ms).ok()?;
        Some(closed)
    }

    /// The open round's closed commitments, if the randomness is to be drawn at `time_ms`.
    pub fn to_draw(&self, time_ms: u64) -> Option<&CommitmentsClosing> {
        let round = self.round.as_ref()?;
        let closing = round.closing.as_ref()?;
        let in_time = time_ms <= self.randomness_deadline_ms(round, closing);
        let wanted = round.randomness.is_none() && !round.commits.is_empty();
        (in_time && wanted).then_some(closing)
    }

    /// The last moment for the randomness, in Unix milliseconds.
    pub(super) fn randomness_deadline_ms(
        &self,
        round: &Round,
        closing: &CommitmentsClosing,
    ) -> u64 {
        closing
            .time_ms
            .saturating_add(self.rules.randomness_window_ms)
            .saturating_add(round.moved_ms)
    }

    pub(super) fn check_commitments_closed(
        &self,
        closed: &CommitmentsClosed,
        time_ms: u64,
    ) -> Result<(), RuleViolation> {
        let round = self.open_round(closed.round)?;
        if round.closing.is_some() {
            return Err(RuleViolation::Again {
                round: round.number(),
                what: "the commitments",
                done: "are closed",
            });
        }
        if let Some(node) = self.awaited(round, time_ms) {
            return Err(RuleViolation::CommitmentsOpen {
                round: round.number(),
                early_ms: round.opened.commit_deadline_ms - time_ms,
                node,
            });
        }
        match self.commitments(round) {
            expected if expected == closed.commitments => Ok(()),
            expected => Err(RuleViolation::RoundField {
                round: round.number(),
                field: "commitments",
                found: closed.commitments.to_string(),
                expected: expected.to_string(),
            }),
        }
    }

    pub(super) fn close_commitments(&mut self, closing: CommitmentsClosing) {
        if let Some(round) = &mut self.round {
            round.closing = Some(closing);
            round.commitments_moved = round.moved_ms > 0;
            round.moved_ms = 0;
        }
    }

    pub(super) fn check_drawn(
        &self,
        drawn: &RandomnessDrawn,
        time_ms: u64,
    ) -> Result<(), RuleViolation> {
        let round = self.open_round(drawn.round)?;
        let number = round.number();
        let Some(closing) = &round.closing else {
            return Err(RuleViolation::NotClosed(number));
        };
        if round.randomness.is_some() {
            return Err(RuleViolation::Again {
                round: number,
                what: "the randomness",
                done: "is drawn",
            });
        }
        let late_ms = time_ms.saturating_sub(self.randomness_deadline_ms(round, closing));
        if late_ms > 0 {
            return Err(RuleViolation::RandomnessLate {
                round: number,
                late_ms,
            });
        }
        let context = DrawContext {
            rules: &self.rules,
            origin: self.genesis.origin(),
            log_key: self.drawing_key(round),
            closing,
            recorded_ms: time_ms,
        };
        let verified = drawn.drawing.verify(&context);
        verified.map_err(|error| RuleViolation::BadRandomness {
            round: number,
            error,
        })
    }

    /// The key whose function draws a round's randomness: the log's at the opening. Otherwise the operator could choose among keys once it knows
    /// commitments.
    fn drawing_key(&self, round: &Round) -> &[u8; 32] {
        self.log_keys.at(round.entry.saturating_add(1))
    }

    /// Whether the log still has the key that draws the open round's randomness by its function.
    pub fn has_drawing_key(&self) -> bool {
        let mut open = self.round.iter();
        open.all(|round| self.drawing_key(round) == self.log_keys.present())
    }

    pub(super) fn draw(&mut self, drawn: &RandomnessDrawn, index: u64, now: u64) {
        let window = self.rules.submit_window_ms;
        if let Some(round) = &mut self.round {
            round.moved_ms = 0;
            round.randomness = drawn.drawing.value().map(|value| Randomness {
                value,
                entry: index,
                submit_deadline_ms: now.saturating_add(window),
            });
        }
    }

    pub(super) fn open_round(&self, number: u64) -> Result<&Round, RuleViolation> {
        let open = self.round.as_ref();
        open.filter(|round| round.number() == number)
            .ok_or(RuleViolation::RoundNotOpen(number))
    }

    fn awaited(&self, round: &Round, time_ms: u64) -> Option<NodeId> {
        let over = time_ms > round.opened.commit_deadline_ms;
        if over || round.commits.len() >= MAX_COMMITS {
            return None;
        }
        let awaits = |known: &Node| round.commits.is_empty() || known.record.is_awaited();
        let mut nodes = self.nodes.iter();
        let (awaited, _) = nodes.find(|(node, known)| {
            awaits(known) && self.may_contribute(round, node) && !round.commits.contains_key(node)
        })?;
        Some(*awaited)
    }

    fn commitments(&self, round: &Round) -> Digest {
        let by_node = round.commits.iter();
        commitments(
            &self.network,
            round.number(),
            by_node.map(|(node, commit)| (node, &commit.commitment)),
        )
    }
}
