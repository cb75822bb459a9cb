//! Federated averaging (McMahan et al., 2017, arXiv:1602.05629).
//!
//! For each weight, the products of a contribution's weight and its value are summed, and divided once by the sum of the
//! contributions' weights. All of it is computed in integers, so that the sum is exact and the order of the contributions does not matter.

use crate::combine::contributions::{CombineError, Fractions, Part};
use zk0_weights::scale::exact;

/// The weighted mean of one tensor.
///
/// In units of 2^−24 a value is below 2^39 in magnitude, so that a sum of up to 2^23 products with weights below 2^64 fits 128 bits.
/// A round has far fewer contributions.
pub fn average(parts: &[Part<'_>]) -> Result<Fractions, CombineError> {
    let divisor = parts.iter().map(|part| i128::from(part.weight)).sum();
    if divisor == 0 {
        return Err(CombineError::Empty);
    }
    let len = parts.first().map_or(0, |part| part.values.len());
    let mut numerators = vec![0i128; len];
    for part in parts {
        let factor = i128::from(part.weight) * i128::from(exact(1, part.bits));
        for (sum, value) in numerators.iter_mut().zip(part.values) {
            *sum += factor * i128::from(*value);
        }
    }
    Ok(Fractions {
        numerators,
        divisor,
    })
}
