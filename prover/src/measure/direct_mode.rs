//! Whether claims of a policy can be proven in mode `direct`, in which the guest multiplies by every weight.

/// Guest cycles of a multiply-add in mode `direct`, at best.
const CYCLES: u64 = 4;

/// With this many weights or more, mode `direct` takes more than twice the cycles of `checked` (docs/prove.md, "Which mode is cheaper?").
const DEAR_WEIGHTS: u64 = 30_000;

/// If the multiply-adds alone take this many cycles, a proof takes more than a day on two cores. The other modes take a small part of that.
const ENDLESS_CYCLES: u64 = 1_000_000_000;

/// What mode `direct` costs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DirectCost {
    /// No more than mode `checked`, or little more.
    Fair,
    /// More than twice the cycles of mode `checked`.
    Dear,
    /// More than a day for one claim.
    Endless,
}

/// The multiply-adds of a claim in mode `direct`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DirectMode {
    /// The weights of the policy's expert.
    pub weights: u64,
    /// Samples evaluated for a claim.
    pub samples: u32,
    /// Frames of an action chunk.
    pub chunk: u64,
}

impl DirectMode {
    /// The cycles that the multiply-adds take at best: both models use every weight once for each sample and each frame of the chunk.
    pub fn cycles(&self) -> u64 {
        [2, u64::from(self.samples), self.chunk, self.weights]
            .into_iter()
            .fold(CYCLES, u64::saturating_mul)
    }

    /// Whether that is a fair cost.
    pub fn cost(&self) -> DirectCost {
        if self.cycles() >= ENDLESS_CYCLES {
            DirectCost::Endless
        } else if self.weights >= DEAR_WEIGHTS {
            DirectCost::Dear
        } else {
            DirectCost::Fair
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cost_grows_with_weights_and_samples() {
        let cost = |weights, samples| {
            let chunk = 50;
            DirectMode {
                weights,
                samples,
                chunk,
            }
            .cost()
        };
        assert_eq!(cost(29_999, 4), DirectCost::Fair);
        assert_eq!(cost(30_000, 4), DirectCost::Dear);
        assert_eq!(cost(98_000_000, 1), DirectCost::Endless);
        assert_eq!(cost(u64::MAX, u32::MAX), DirectCost::Endless);
    }
}
