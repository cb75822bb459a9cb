//! The weights that the last rounds ended with, so that a vote can restore some.
//!
//! A vote names a round, which people can read on a ballot. A vote on weights would need this list too, to keep out unproven
//! ones. A limit bounds the memory for following a log.

use borsh::{BorshDeserialize, BorshSerialize};
use std::collections::BTreeMap;
use zk0_circuits::WeightsDigest;

/// How many results are remembered, with 72 bytes each in a saved state, or 288 KiB: 24 weeks, with a round an hour. Older
/// weights are too old to restore.
pub const REMEMBERED_RESULTS: usize = 1 << 12;

/// The results of the last [`REMEMBERED_RESULTS`] closed rounds.
#[derive(Clone, Debug, Default, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RoundResults {
    by_round: BTreeMap<u64, WeightsDigest>,
}

impl RoundResults {
    /// A round's final weights.
    pub fn of(&self, round: u64) -> Option<&WeightsDigest> {
        self.by_round.get(&round)
    }

    /// Remembers a round's final weights, and forgets the oldest beyond the limit.
    pub(crate) fn remember(&mut self, round: u64, global: WeightsDigest) {
        self.by_round.insert(round, global);
        if self.by_round.len() > REMEMBERED_RESULTS {
            self.by_round.pop_first();
        }
    }
}
