//! Averages that a few bad updates cannot move far: the median and the trimmed mean of each parameter (Yin et al., 2018,
//! arXiv:1803.01498).
//!
//! Every contributor counts alike: weights by samples would let whoever claims most samples be the median. Values are compared and
//! summed as exact integers, so that the order of the contributions does not matter.

use crate::combine::contributions::{CombineError, Fractions, Part};
use zk0_protocol::rules::basis_points::BPS;
use zk0_weights::scale::exact;

/// The median of one tensor's parameters; the mean of the two in the middle where their number is even.
pub fn median(parts: &[Part<'_>]) -> Result<Fractions, CombineError> {
    middle_mean(parts, |count| (count - 1) / 2)
}

/// The mean of one tensor's parameters without the largest and the smallest values: `trim_bps` of the contributors, in basis points
/// and rounded down, at either end.
pub fn trimmed_mean(parts: &[Part<'_>], trim_bps: u32) -> Result<Fractions, CombineError> {
    let share = trim_bps.min(BPS / 2 - 1) as usize;
    middle_mean(parts, |count| count * share / BPS as usize)
}

/// The mean of what is left of each parameter's values when `left_out(count)` are left out at either end.
fn middle_mean(
    parts: &[Part<'_>],
    left_out: impl Fn(usize) -> usize,
) -> Result<Fractions, CombineError> {
    let Some(first) = parts.first() else {
        return Err(CombineError::Empty);
    };
    let out = left_out(parts.len());
    let kept = out..parts.len() - out;
    let mut column = vec![0i64; parts.len()];
    let mut middle = |at: usize| {
        for (value, part) in column.iter_mut().zip(parts) {
            *value = exact(part.values[at], part.bits);
        }
        column.sort_unstable();
        column[kept.clone()].iter().copied().map(i128::from).sum()
    };
    Ok(Fractions {
        numerators: (0..first.values.len()).map(&mut middle).collect(),
        divisor: kept.len() as i128,
    })
}
