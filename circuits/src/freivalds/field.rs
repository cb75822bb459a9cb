//! The prime field of 2^107 − 1 elements (a Mersenne prime), in which products are checked.
//!
//! The field is large enough for 100 bits of soundness in one repetition, and inner products need no reduction on the way: a
//! random coefficient of 104 bits has four signed limbs of 26 bits, an element has three limbs of 36 bits, and an int64 holds
//! the sums of limbs times int32 or int16.

use alloc::vec::Vec;
use core::ops::{Add, Sub};

/// Bits of the modulus.
pub const BITS: u32 = 107;
/// The modulus.
pub const MODULUS: u128 = (1 << BITS) - 1;

/// A field element, below the modulus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Element(u128);

/// Limbs of an [`Element`], 36 bits each, the lowest first.
pub type Limbs = [u64; 3];
/// Bits of one of [`Limbs`].
pub const LIMB_BITS: u32 = 36;

impl Element {
    /// Zero.
    pub const ZERO: Self = Self(0);

    /// Returns the residue of an integer.
    pub fn from_i128(value: i128) -> Self {
        let magnitude = Self::reduce(value.unsigned_abs());
        if value < 0 {
            magnitude.negate()
        } else {
            magnitude
        }
    }

    fn reduce(value: u128) -> Self {
        let sum = (value & MODULUS) + (value >> BITS);
        Self(if sum >= MODULUS { sum - MODULUS } else { sum })
    }

    fn negate(self) -> Self {
        Self::reduce(MODULUS - self.0)
    }

    /// Multiplies by 2^`bits`, for `bits` below 107. This rotates the bits.
    pub fn shift(self, bits: u32) -> Self {
        if bits == 0 {
            return self;
        }
        let low = self.0 << bits & MODULUS;
        Self::reduce(low | self.0 >> (BITS - bits))
    }

    /// Returns Σ `parts[i]` · 2^(`bits`·i), for |`parts[i]`| < 2^(126 − `bits`): two neighbours fit an int128.
    pub fn compose<const N: usize>(parts: [i128; N], bits: u32) -> Self {
        let mut sum = Self::ZERO;
        for (index, pair) in parts.chunks(2).enumerate() {
            let value = pair.iter().rev().fold(0, |high, low| (high << bits) + low);
            sum = sum + Self::from_i128(value).shift(2 * bits * index as u32);
        }
        sum
    }

    /// Splits the element into three limbs.
    pub fn limbs(self) -> Limbs {
        let limb = |index: u32| (self.0 >> (LIMB_BITS * index)) as u64 & ((1 << LIMB_BITS) - 1);
        [limb(0), limb(1), limb(2)]
    }
}

impl Add for Element {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::reduce(self.0 + other.0)
    }
}

impl Sub for Element {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self.add(other.negate())
    }
}

/// Returns the limbs of all `elements`.
pub fn limbs(elements: &[Element]) -> Vec<Limbs> {
    elements.iter().map(|element| element.limbs()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn residue(value: i128) -> u128 {
        value.rem_euclid(MODULUS as i128) as u128
    }

    proptest! {
        #[test]
        fn arithmetic_is_that_of_integers(a: i128, b: i128, bits in 0u32..107) {
            let (x, y) = (Element::from_i128(a), Element::from_i128(b));
            prop_assert_eq!(x.0, residue(a));
            prop_assert_eq!((x + y).0, (residue(a) + residue(b)) % MODULUS);
            prop_assert_eq!(x - y + y, x);
            let mut doubled = x;
            (0..bits).for_each(|_| doubled = doubled + doubled);
            prop_assert_eq!(x.shift(bits), doubled);
            let parts = x.limbs().map(|limb| limb as i128);
            prop_assert!(x.limbs().iter().all(|limb| limb >> 36 == 0));
            prop_assert_eq!(Element::compose(parts, 36), x);
        }
    }

    #[test]
    fn the_modulus_is_zero() {
        assert_eq!(Element::from_i128(MODULUS as i128), Element::ZERO);
        assert_eq!(Element::from_i128(-(MODULUS as i128)), Element::ZERO);
        assert_eq!(Element::ZERO - Element::ZERO, Element::ZERO);
        assert_eq!(Element::from_i128(i128::MIN).0, residue(i128::MIN));
    }
}
