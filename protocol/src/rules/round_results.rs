//! The weights that the last rounds ended with, so that a vote can go back to those of one of them.
//!
//! A vote names a round and not the weights themselves. If it named weights, the state would still have to know which weights rounds
//! ended with: otherwise a vote could bring in weights that nobody has proven. So the state remembers them, and a number is what people
//! can read on a ballot. Their number is limited, so that following a log takes a limited amount of memory.

use borsh::{BorshDeserialize, BorshSerialize};
use std::collections::BTreeMap;
use zk0_circuits::WeightsDigest;

/// How many rounds' results are remembered. Each takes 72 bytes in a saved state, and all of them 288 KiB. With a round an hour, this
/// reaches back 24 weeks. Weights that are older than that would throw away too much for a vote to go back to them.
pub const REMEMBERED_RESULTS: usize = 1 << 12;

/// The results of the last [`REMEMBERED_RESULTS`] closed rounds.
#[derive(Clone, Debug, Default, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RoundResults {
    by_round: BTreeMap<u64, WeightsDigest>,
}

impl RoundResults {
    /// The weights that a round ended with.
    pub fn of(&self, round: u64) -> Option<&WeightsDigest> {
        self.by_round.get(&round)
    }

    /// Remembers what a round ended with, and forgets the oldest beyond the limit.
    pub(crate) fn remember(&mut self, round: u64, global: WeightsDigest) {
        self.by_round.insert(round, global);
        if self.by_round.len() > REMEMBERED_RESULTS {
            self.by_round.pop_first();
        }
    }
}
