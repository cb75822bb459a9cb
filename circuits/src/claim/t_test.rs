//! The test that an improvement passes: a one-sided paired t-test, in exact integers.
//!
//! Base and update are evaluated on the same samples, with the same noise and flow times. With bᵢ and uᵢ the squared errors on sample
//! i, and m the minimum improvement, the differences are dᵢ = (1 − m)·bᵢ − uᵢ. Their sum D is positive where the update is better
//! than the base by more than m. How sure one can be of that follows from how the differences spread:
//!
//!   D·√(n − 1) / √(n·Σdᵢ² − D²)
//!
//! is Student's t-statistic with n − 1 degrees of freedom ("Student", The probable error of a mean, Biometrika 6, 1908). The test
//! passes if it exceeds the quantile of the asked confidence. Both sides are squared, so that nothing is rounded.
//!
//! `make power` measures what the test is worth, and `docs/samples.md` states what came out.

use crate::claim::challenge::MAX_EVAL_SAMPLES;
use crate::claim::student::{quantile, Confidence};
use borsh::{BorshDeserialize, BorshSerialize};
use core::fmt::{self, Display};
use ethnum::U256;

/// Basis points of one.
const ONE: i128 = 10_000;

/// What an improvement has to be, and how sure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct TTest {
    /// Least relative improvement, in basis points (1/100 of a percent). At most 10,000.
    pub min_improvement_bps: u32,
    /// How sure it has to be.
    pub confidence: Confidence,
}

impl Display for TTest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            min_improvement_bps,
            confidence,
        } = self;
        write!(
            f,
            "an improvement by {min_improvement_bps} basis points at a confidence of {confidence}"
        )
    }
}

/// The squared errors of the two models on one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pair {
    /// Under the base weights.
    pub base: u64,
    /// Under the update.
    pub update: u64,
}

impl TTest {
    /// Whether the update improves on the base as asked. Fewer than two samples never show it, nor do more than [`MAX_EVAL_SAMPLES`].
    pub fn passes(&self, pairs: &[Pair]) -> bool {
        let kept = ONE - (self.min_improvement_bps as i128).min(ONE);
        if pairs.len() > MAX_EVAL_SAMPLES as usize {
            return false;
        }
        let samples = pairs.len() as u32;
        let Some(quantile) = quantile(samples, self.confidence) else {
            return false;
        };
        // |d| < 2^14 · 2^64, so that |sum| < 2^90, and the squares sum up to less than 2^168.
        let (mut sum, mut squares) = (0i128, U256::ZERO);
        for pair in pairs {
            let difference = kept * pair.base as i128 - ONE * pair.update as i128;
            sum += difference;
            let size = U256::from(difference.unsigned_abs());
            squares += size * size;
        }
        if sum <= 0 {
            return false;
        }
        let square = U256::from(sum.unsigned_abs()) * U256::from(sum.unsigned_abs());
        // By the inequality of Cauchy and Schwarz this is never negative.
        let spread = U256::from(samples) * squares - square;
        // The quantile is in thousandths and below 2^19: both sides stay below 2^220.
        let left = square * U256::from(samples - 1) * U256::from(1_000_000u32);
        let right = U256::from(quantile) * U256::from(quantile) * spread;
        left > right
    }
}
