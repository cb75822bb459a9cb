//! Which mode is the best for a policy: `direct`, in which the guest multiplies by every weight, or `succinct`.

use zk0_circuits::Mode;

/// Guest cycles of a multiply-add in mode `direct`, at best.
const CYCLES: u64 = 4;

/// Guest cycles of a claim in mode `succinct`, which hardly depend on the policy's size: so many, and so many more for each sample. This is a little more than
/// what `make cycles` prints.
const SUCCINCT_CYCLES: (u64, u64) = (4_400_000, 800_000);

/// If the multiply-adds alone take this many cycles, a proof takes more than a day on two cores.
const ENDLESS_CYCLES: u64 = 1_000_000_000;

/// What mode `direct` costs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DirectCost {
    /// No more than mode `succinct`.
    Fair,
    /// More cycles than mode `succinct`.
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

    /// The mode in which a claim takes the fewest cycles.
    pub fn best(&self) -> Mode {
        match self.cost() {
            DirectCost::Fair => Mode::Direct,
            DirectCost::Dear | DirectCost::Endless => Mode::Succinct,
        }
    }

    /// Whether that is a fair cost.
    pub fn cost(&self) -> DirectCost {
        let (all, each) = SUCCINCT_CYCLES;
        if self.cycles() >= ENDLESS_CYCLES {
            DirectCost::Endless
        } else if self.cycles() > all + each * u64::from(self.samples) {
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
        let cost = |weights, samples, chunk| {
            DirectMode {
                weights,
                samples,
                chunk,
            }
            .cost()
        };
        // The demo's policy.
        assert_eq!(cost(4_120, 6, 6), DirectCost::Fair);
        // Four samples take 7.6 million cycles in mode `succinct`.
        assert_eq!(cost(4_750, 4, 50), DirectCost::Fair);
        assert_eq!(cost(4_751, 4, 50), DirectCost::Dear);
        assert_eq!(cost(98_000_000, 1, 50), DirectCost::Endless);
        assert_eq!(cost(u64::MAX, u32::MAX, 50), DirectCost::Endless);
    }
}
