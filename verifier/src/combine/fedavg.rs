//! Federated averaging (McMahan et al., 2017, arXiv:1602.05629), bit-exact on every machine and for every order of input.
//!
//! For each parameter: products of weight and value are summed in IEEE 754 double precision, in ascending order of node
//! identity, divided once by the sum of the weights, and rounded once to float32 (to nearest, ties to even). Nothing is
//! fused or reordered. A float32 times a weight below 2^29 is exact in a double, so one contribution alone averages to
//! itself.

use crate::combine::contributions::{aligned, CombineError};
use crate::ExpertTensors;
use zk0_circuits::NodeId;

/// The weighted average of `(node, weight, tensors)`; the order they are given in does not matter.
pub fn average(weighted: &[(NodeId, u64, &ExpertTensors)]) -> Result<ExpertTensors, CombineError> {
    let weighted = aligned(weighted)?;
    let total = weighted
        .iter()
        .fold(0.0, |sum, (_, samples, _)| sum + *samples as f64);
    let [(_, _, first), ..] = weighted[..] else {
        return Err(CombineError::Empty);
    };
    if total == 0.0 {
        return Err(CombineError::Empty);
    }
    let average = first.map(|name, values| {
        // The sum starts with −0.0, because it changes no number that is added to it, not even a negative zero.
        let mut sums = vec![-0.0f64; values.len()];
        for (_, samples, tensors) in &weighted {
            let samples = *samples as f64;
            for (sum, value) in sums.iter_mut().zip(tensors.get(name).unwrap_or_default()) {
                *sum += samples * f64::from(*value);
            }
        }
        sums.into_iter().map(|sum| (sum / total) as f32).collect()
    })?;
    Ok(average)
}
