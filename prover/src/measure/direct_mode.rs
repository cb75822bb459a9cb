//! The best mode for a policy: `direct`, in which the guest multiplies by every weight, or `succinct`.

use zk0_circuits::Mode;

/// Best-case guest cycles of a multiply-add in mode `direct`.
const CYCLES: u64 = 4;

/// Guest cycles of a claim in mode `succinct`, for most policies: a constant, and more per sample, slightly above what `make cycles`
/// prints.
const SUCCINCT_CYCLES: (u64, u64) = (4_400_000, 800_000);

/// With these multiply-adds alone, a proof takes over a day on two cores.
const ENDLESS_CYCLES: u64 = 1_000_000_000;

/// The cost of mode `direct`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DirectCost {
    /// At most that of mode `succinct`.
    Fair,
    /// Above that of mode `succinct`.
    Dear,
    /// Over a day for one claim.
    Endless,
}

/// The multiply-adds of mode `direct`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DirectMode {
    /// The weights of the expert.
    pub weights: u64,
    /// Samples evaluated.
    pub samples: u32,
    /// Frames of a chunk.
    pub chunk: u64,
}

impl DirectMode {
    /// Best-case cycles: both models use each weight once per sample and frame.
    pub fn cycles(&self) -> u64 {
        [2, u64::from(self.samples), self.chunk, self.weights]
            .into_iter()
            .fold(CYCLES, u64::saturating_mul)
    }

    /// The mode with the fewest cycles.
    pub fn best(&self) -> Mode {
        match self.cost() {
            DirectCost::Fair => Mode::Direct,
            DirectCost::Dear | DirectCost::Endless => Mode::Succinct,
        }
    }

    /// How fair that cost is.
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
