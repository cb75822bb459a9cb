//! Products of elements of the extension as the prover computes them: without branches that it cannot predict.

use super::goldilocks::{reduce, Goldilocks, P};
use core::hint::select_unpredictable;

/// x² of the extension.
pub const SQUARE: u128 = 7;
/// 2^128 mod p, which is −2^32.
const WRAPPED: u128 = P as u128 - (1 << 32);

/// The coefficients of the product of two elements with these coefficients.
#[inline(always)]
pub fn multiply([a0, a1]: [Goldilocks; 2], [b0, b1]: [Goldilocks; 2]) -> [Goldilocks; 2] {
    let square = reduce(product(a1, b1)).value() as u128 * SQUARE;
    [
        reduce(product(a0, b0) + square), // stays below 2^128
        reduce(wrapping_sum(product(a0, b1), product(a1, b0))),
    ]
}

/// The product of two elements, not yet taken modulo p.
#[inline(always)]
pub fn product(a: Goldilocks, b: Goldilocks) -> u128 {
    a.value() as u128 * b.value() as u128
}

/// A value that is `a + b` in the field, where `b` is a product of two elements.
#[inline(always)]
pub fn wrapping_sum(a: u128, b: u128) -> u128 {
    let (sum, carry) = a.overflowing_add(b);
    // After a carry the sum is below (p − 1)², so that this does not carry again.
    select_unpredictable(carry, sum.wrapping_add(WRAPPED), sum)
}
