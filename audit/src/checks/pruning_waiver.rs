//! Waives blobs that the log's operator signed as pruned, and records the rounds that cannot be repeated.

use crate::account::SkipReason;
use borsh::{BorshDeserialize, BorshSerialize};
use std::fmt;
use zk0_protocol::pruning::Pruning;
use zk0_protocol::rules::named_blobs::BlobKind;

/// Most ranges of rounds in a report.
const LISTED: usize = 16;

/// The operator's statement about blobs of one entry of one round.
#[derive(Clone, Copy, Debug, Default)]
pub struct PruningWaiver(Option<(Pruning, u64, u64)>);

impl PruningWaiver {
    /// The waiver by `pruning` for entry `index` in this round.
    pub fn of(pruning: Option<Pruning>, round: u64, index: u64) -> Self {
        Self(pruning.map(|pruning| (pruning, round, index)))
    }

    /// Whether a blob of this kind may be missing.
    pub fn covers(&self, kind: &BlobKind) -> bool {
        self.0
            .is_some_and(|(pruning, round, index)| pruning.excuses(kind, round, index))
    }

    /// Why a check without a blob of this kind is left out.
    pub fn why(&self, kind: &BlobKind) -> SkipReason {
        if self.covers(kind) {
            SkipReason::Pruned
        } else {
            SkipReason::NotAtHand
        }
    }
}

/// Ranges of rounds, ascending.
#[derive(Clone, Debug, Default, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Rounds(Vec<(u64, u64)>);

impl Rounds {
    /// Adds a later round.
    pub fn add(&mut self, round: u64) {
        match self.0.last_mut() {
            Some((_, last)) if last.checked_add(1) == Some(round) => *last = round,
            _ => self.0.push((round, round)),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl fmt::Display for Rounds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let one = matches!(self.0[..], [(first, last)] if first == last);
        f.write_str(if one { "round " } else { "rounds " })?;
        for (number, (first, last)) in self.0.iter().take(LISTED).enumerate() {
            if number > 0 {
                f.write_str(", ")?;
            }
            if first == last {
                write!(f, "{first}")?
            } else {
                write!(f, "{first} to {last}")?
            }
        }
        match self.0.len().saturating_sub(LISTED) {
            0 => Ok(()),
            more => write!(f, " and {more} more ranges"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_are_listed_as_ranges() {
        let mut rounds = Rounds::default();
        assert!(rounds.is_empty());
        rounds.add(3);
        assert_eq!(rounds.to_string(), "round 3");
        for round in [4, 5, 9, 11, 12] {
            rounds.add(round);
        }
        assert_eq!(rounds.to_string(), "rounds 3 to 5, 9, 11 to 12");
        for round in (20..).step_by(2).take(20) {
            rounds.add(round);
        }
        assert!(rounds.to_string().ends_with(", 44 and 7 more ranges"));
    }
}
