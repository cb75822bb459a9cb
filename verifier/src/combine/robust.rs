//! Averages that a few bad updates cannot move far: the median and the trimmed mean of each parameter (Yin et al., 2018,
//! arXiv:1803.01498), bit-exact on every machine and for every order of input.
//!
//! Every contributor counts alike: weights by samples would let whoever claims most samples be the median. Values are ordered as
//! IEEE 754 orders them in total (−0 before +0); means are sums in double precision, in ascending order, divided once and
//! rounded once to float32.

use crate::combine::contributions::{aligned, CombineError};
use crate::ExpertTensors;
use zk0_circuits::NodeId;
use zk0_protocol::rules::basis_points::BPS;

/// The median of each parameter; the mean of the two in the middle where their number is even.
pub fn median(given: &[(NodeId, u64, &ExpertTensors)]) -> Result<ExpertTensors, CombineError> {
    let middle = |count: usize| (count - 1) / 2;
    middle_mean(given, middle)
}

/// The mean of each parameter without the largest and the smallest values: `trim_bps` of the contributors, in basis points and
/// rounded down, at either end.
pub fn trimmed_mean(
    given: &[(NodeId, u64, &ExpertTensors)],
    trim_bps: u32,
) -> Result<ExpertTensors, CombineError> {
    let share = trim_bps.min(BPS / 2 - 1) as usize;
    middle_mean(given, |count| count * share / BPS as usize)
}

/// The mean of what is left of each parameter's values when `left_out(count)` are left out at either end.
fn middle_mean(
    given: &[(NodeId, u64, &ExpertTensors)],
    left_out: impl Fn(usize) -> usize,
) -> Result<ExpertTensors, CombineError> {
    let given = aligned(given)?;
    let [(_, _, first), ..] = given[..] else {
        return Err(CombineError::Empty);
    };
    let out = left_out(given.len());
    let kept = out..given.len() - out;
    let mut column = vec![0f32; given.len()];
    let combined = first.map(|name, values| {
        let tensors: Vec<_> = given
            .iter()
            .map(|(_, _, tensors)| tensors.get(name).unwrap_or_default())
            .collect();
        (0..values.len())
            .map(|at| {
                for (value, tensor) in column.iter_mut().zip(&tensors) {
                    *value = tensor[at];
                }
                column.sort_unstable_by(f32::total_cmp);
                let kept = &column[kept.clone()];
                // The sum starts with −0.0, because it changes no number that is added to it, not even a negative zero.
                let sum = kept.iter().fold(-0.0, |sum, value| sum + f64::from(*value));
                (sum / kept.len() as f64) as f32
            })
            .collect()
    })?;
    Ok(combined)
}
