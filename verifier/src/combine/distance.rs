//! Squared Euclidean distances between weights, in exact integers.
//!
//! The unit is 2^−48, the square of the weights' finest unit. A difference is below 2^40 in magnitude, so the sum of up to 2^47
//! squares fits 128 bits.

use zk0_circuits::model::layout::MAX_WEIGHT_BITS;
use zk0_weights::rounding::exact;

/// The widest gap of scales for the short way.
const CLOSE: i16 = 6;

/// Values with their fraction bits.
#[derive(Clone, Copy, Debug)]
pub struct FixedPointValues<'a> {
    /// The values, at most a block.
    pub values: &'a [i16],
    /// Their fraction bits.
    pub bits: i16,
}

/// The squared distance of two blocks.
pub fn squared(one: FixedPointValues<'_>, other: FixedPointValues<'_>) -> u128 {
    let pairs = one.values.iter().zip(other.values);
    if (one.bits - other.bits).abs() > CLOSE {
        let squares = pairs.map(|(a, b)| {
            let difference = exact(*a, one.bits) - exact(*b, other.bits);
            let magnitude = u128::from(difference.unsigned_abs());
            magnitude * magnitude
        });
        return squares.sum();
    }
    // At the finer scale a difference is below 2^22 in magnitude, and the sum of a block's squares is below 2^60.
    let finer = one.bits.max(other.bits);
    let (of_one, of_other) = (1 << (finer - one.bits), 1 << (finer - other.bits));
    let squares = pairs.map(|(a, b)| {
        let difference: i32 = i32::from(*a) * of_one - i32::from(*b) * of_other;
        i64::from(difference) * i64::from(difference)
    });
    let sum: i64 = squares.sum();
    u128::from(sum.unsigned_abs()) << (2 * (MAX_WEIGHT_BITS - finer).max(0))
}

/// The squared norm of a block.
pub fn squared_norm(one: FixedPointValues<'_>) -> u128 {
    let squares = one.values.iter();
    let sum: i64 = squares.map(|a| i64::from(*a) * i64::from(*a)).sum();
    u128::from(sum.unsigned_abs()) << (2 * (MAX_WEIGHT_BITS - one.bits).max(0))
}
