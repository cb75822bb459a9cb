//! Sums of products with int16 values. Halves of coefficients times such values need no reduction, and their sums fit in 64 bits: that takes
//! half the cycles of [`Extension::dot`].

use super::{Extension, Goldilocks};

/// An element's coefficients, cut into halves of 32 bits: lower, upper, lower, upper.
#[derive(Clone, Copy, Default)]
pub struct Halves([i64; 4]);

impl From<Extension> for Halves {
    #[inline(always)]
    fn from(element: Extension) -> Self {
        let [a, b] = element.0.map(Goldilocks::value);
        let half = |value: u64| (value & 0xffff_ffff) as i64;
        Self([half(a), half(a >> 32), half(b), half(b >> 32)])
    }
}

/// `Σ weights · values`, of as many as there are of both. There are up to 2^15 of them, so that no sum reaches 2^63.
#[inline(always)]
pub fn dot(weights: &[Halves], values: &[i16]) -> Extension {
    debug_assert!(values.len() <= 1 << 15);
    let mut sums = [0i64; 4];
    for (weight, &value) in weights.iter().zip(values) {
        for (sum, half) in sums.iter_mut().zip(weight.0) {
            *sum += half * value as i64;
        }
    }
    const UPPER: Goldilocks = Goldilocks::from_i64(1 << 32);
    let [a, b, c, d] = sums.map(Goldilocks::from_i64);
    Extension([a + b * UPPER, c + d * UPPER])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sum_is_that_of_the_field() {
        let most = Goldilocks::ZERO - Goldilocks::ONE;
        let weights: Vec<Extension> = (0..1 << 15)
            .map(|n| Extension([most - Goldilocks::from_u32(n), most]))
            .collect();
        let values: Vec<i16> = (0..1 << 15)
            .map(|n| if n % 3 == 0 { i16::MIN } else { i16::MAX })
            .collect();
        let halves: Vec<Halves> = weights.iter().map(|&weight| weight.into()).collect();
        let elements: Vec<Goldilocks> = values.iter().map(|&value| value.into()).collect();
        assert_eq!(dot(&halves, &values), Extension::dot(&weights, &elements));
    }
}
