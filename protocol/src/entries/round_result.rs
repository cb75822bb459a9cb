//! The outcome of a round's result.

use borsh::{BorshDeserialize, BorshSerialize};
use std::fmt;
use zk0_circuits::WeightsDigest;

/// A round's result, evaluated on the network's public samples.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct EvaluatedResult {
    /// The combination of the contributions.
    pub weights: WeightsDigest,
    /// The losses' elements: unpadded frames times real action dimensions, over all public samples.
    pub elements: u64,
    /// The loss of the round's base weights.
    pub base: PublicLoss,
    /// The loss of the result.
    pub result: PublicLoss,
    /// Whether the result was taken, by the losses and the rules
    /// ([`crate::rules::closing::public_samples::PublicSamples::outcome`]).
    pub outcome: ResultOutcome,
}

/// The loss of weights on the public samples.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum PublicLoss {
    /// The sum of squared errors, in units of 2^(−2·fraction bits of the velocity).
    SquaredError(u64),
    /// A value does not fit the fixed-point evaluation.
    Overflow {
        /// The first such sample, from 0.
        sample: u32,
    },
}

/// Whether a round's result became the new global weights. Otherwise the base stays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum ResultOutcome {
    /// Taken.
    Taken,
    /// Not taken: it overflows on a public sample.
    Overflow,
    /// Not taken: its loss exceeds the base's by too much.
    Worse,
}

impl EvaluatedResult {
    /// Mean squared errors of base and result, unless they overflow. `action_bits` are the velocity's fraction bits
    /// ([`zk0_circuits::EvalSpec::action`]).
    pub fn means(&self, action_bits: u8) -> (Option<f64>, Option<f64>) {
        let unit = self.elements.max(1) as f64 * 4f64.powi(action_bits.into());
        let mean = |loss: &PublicLoss| match loss {
            PublicLoss::SquaredError(sum) => Some(*sum as f64 / unit),
            PublicLoss::Overflow { .. } => None,
        };
        (mean(&self.base), mean(&self.result))
    }
}

impl fmt::Display for PublicLoss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SquaredError(sum) => write!(f, "a squared error of {sum}"),
            Self::Overflow { sample } => write!(f, "an overflow on sample {sample}"),
        }
    }
}

impl fmt::Display for ResultOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Taken => "the result was taken",
            Self::Overflow => "the result was not taken, because it overflows on a public sample; the round kept its base",
            Self::Worse => {
                "the result was not taken, because its loss on the public samples is worse than the rules allow; the round kept its base"
            }
        })
    }
}
