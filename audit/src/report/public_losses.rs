//! A round's result on the network's public samples.

use serde::Serialize;
use zk0_protocol::entries::round_result::{EvaluatedResult, ResultOutcome};

/// Mean squared errors per element on the public samples.
#[derive(Clone, Debug, Serialize)]
pub struct PublicLosses {
    /// Under the round's base weights; `None` if they overflow.
    pub base: Option<f64>,
    /// Under the combined contributions; `None` if that overflows.
    pub result: Option<f64>,
    /// Whether the result became the global weights.
    pub taken: bool,
    /// The outcome in a sentence.
    pub outcome: String,
}

impl PublicLosses {
    /// A closing's record. `action_bits` are the velocity's fraction bits.
    pub fn of(evaluated: &EvaluatedResult, action_bits: u8) -> Self {
        let (base, result) = evaluated.means(action_bits);
        Self {
            base,
            result,
            taken: evaluated.outcome == ResultOutcome::Taken,
            outcome: evaluated.outcome.to_string(),
        }
    }

    /// The outcome, in a word or two.
    pub fn verdict(&self) -> &'static str {
        match (self.taken, self.result) {
            (true, _) => "taken",
            (false, None) => "not taken: overflow",
            (false, Some(_)) => "not taken: worse",
        }
    }
}
