//! Norm clipping: an update too far from the base is scaled down to the longest difference allowed, before the mean by shares. So
//! a contribution moves the result by at most its share of that length.
//!
//! **The scaling**: with the squared norms B of the base and D of the difference, and the limit L in basis points, a difference
//! that is too long counts `s = ⌊2^32 · √(L² · B / (10^8 · D))⌋ / 2^32` times, in integers. Rounding down keeps it within the
//! limit. Other differences count whole.

use crate::combine::contributions::WeightedContribution;
use crate::combine::distance::{squared, squared_norm, FixedPointValues};
use crate::combine::error::CombineError;
use crate::combine::fedavg::whole;
use crate::combine::linear::{LinearCombination, ScaledWeights};
use crate::combine::source::{Block, BlockBuffer, WeightSource};
use ethnum::U256;
use rayon::prelude::*;
use zk0_protocol::rules::basis_points::BPS;
use zk0_weights::Format;

/// The factor 1.
const WHOLE: u64 = 1 << 32;

/// The mean, by shares, of the clipped updates: `base + Σ wᵢ sᵢ (xᵢ − base) / Σ wᵢ`.
pub fn clipped_mean<'a>(
    format: &Format,
    given: &[WeightedContribution<'a>],
    base: &'a dyn WeightSource,
    max_norm_bps: u32,
) -> Result<LinearCombination<'a>, CombineError> {
    let divisor = whole(given)? * i128::from(WHOLE);
    let blocks = Block::all(format);
    let norm = sum(&blocks, &[base], |block, rows| {
        squared_norm(of(base, block, rows[0]))
    })?;
    let mut terms = Vec::with_capacity(given.len() + 1);
    for one in given {
        let difference = sum(&blocks, &[base, one.weights], |block, rows| {
            let before = of(base, block, rows[0]);
            squared(before, of(one.weights, block, rows[1]))
        })?;
        terms.push(ScaledWeights {
            coefficient: i128::from(one.weight)
                * i128::from(factor(norm, difference, max_norm_bps)),
            weights: one.weights,
        });
    }
    let counted: i128 = terms.iter().map(|term| term.coefficient).sum();
    terms.push(ScaledWeights {
        coefficient: divisor - counted,
        weights: base,
    });
    Ok(LinearCombination::new(terms, divisor))
}

fn of<'v>(weights: &dyn WeightSource, block: &Block, values: &'v [i16]) -> FixedPointValues<'v> {
    FixedPointValues {
        values,
        bits: weights.bits(block.tensor),
    }
}

fn sum(
    blocks: &[Block],
    weights: &[&dyn WeightSource],
    of_block: impl Fn(&Block, &[&[i16]]) -> u128 + Sync,
) -> Result<u128, CombineError> {
    let sums = blocks
        .par_iter()
        .map_init(BlockBuffer::default, |rows, block| {
            Ok(of_block(block, &rows.read(weights, block)?))
        });
    sums.try_reduce(|| 0, |one, other| Ok(one + other))
}

/// The factor for a difference with this squared norm, in units of 2^−32.
fn factor(base: u128, difference: u128, max_norm_bps: u32) -> u64 {
    let limit = U256::from(u64::from(max_norm_bps));
    let allowed = limit * limit * U256::from(base);
    let per_bps = U256::from(u64::from(BPS) * u64::from(BPS));
    let found = per_bps * U256::from(difference);
    if found <= allowed {
        return WHOLE;
    }
    // `allowed` is below `found`, so the quotient is below 2^64 and its root below 2^32. Squared norms are below 2^128 and the
    // limit below 2^32, so `allowed` is below 2^192.
    let quotient = (allowed << 64) / found;
    u64::try_from(quotient).unwrap_or(u64::MAX).isqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_that_is_too_long_counts_in_part() {
        // The base's norm is 10, so 5,000 basis points allow 5.
        assert_eq!(factor(100, 25, 5000), WHOLE);
        assert_eq!(factor(100, 100, 5000), WHOLE / 2);
        assert_eq!(factor(100, 400, 5000), WHOLE / 4);
        assert_eq!(factor(0, 1, 5000), 0, "a base of zeros allows nothing");
        assert_eq!(factor(0, 0, 5000), WHOLE);
        let third = factor(100, 225, 5000);
        assert_eq!(third, WHOLE / 3, "rounded down");
        assert!(factor(u128::MAX - 1, u128::MAX, 10_000) < WHOLE);
        assert_eq!(factor(u128::MAX, u128::MAX, 1_000_000), WHOLE);
    }
}
