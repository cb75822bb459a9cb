//! The extension of degree 2 of [`Goldilocks`], with x² = 7: challenges come from its 2^128 elements, so that a cheat that has to hit one
//! of a few of them has no chance.

#[cfg(not(feature = "prove"))]
use crate::field::goldilocks::{reduce, P};
use crate::field::goldilocks::{Goldilocks, Products};
use bytemuck::TransparentWrapper;
use core::iter::Sum;
use core::ops::{Add, AddAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// x².
const SQUARE: Goldilocks = Goldilocks::from_u32(7);

/// An element `c0 + c1·x` of the extension.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(transparent)]
pub struct Extension(pub [Goldilocks; 2]);

// SAFETY: an element is its two coefficients and nothing else.
unsafe impl TransparentWrapper<[Goldilocks; 2]> for Extension {}

impl Extension {
    /// Zero.
    pub const ZERO: Self = Self([Goldilocks::ZERO; 2]);
    /// One.
    pub const ONE: Self = Self([Goldilocks::ONE, Goldilocks::ZERO]);

    /// The elements whose coefficients lie one after the other in `coefficients`.
    #[inline(always)]
    pub fn of_coefficients(coefficients: &[Goldilocks]) -> &[Self] {
        Self::wrap_slice(coefficients.as_chunks().0)
    }

    /// The coefficients of `elements`, one after the other.
    #[inline(always)]
    pub fn coefficients(elements: &[Self]) -> &[Goldilocks] {
        Self::peel_slice(elements).as_flattened()
    }

    /// `self · factor`.
    #[inline(always)]
    pub fn scale(self, factor: Goldilocks) -> Self {
        Self(self.0.map(|coefficient| coefficient * factor))
    }

    /// `self / 2`.
    pub fn halved(self) -> Self {
        Self(self.0.map(Goldilocks::halved))
    }

    /// 1/self, and 0 for 0: `(c0 − c1·x) / (c0² − 7·c1²)`.
    pub fn inverse(self) -> Self {
        let [c0, c1] = self.0;
        let norm = c0 * c0 - SQUARE * c1 * c1;
        Self([c0, -c1]).scale(norm.inverse())
    }

    /// `self^exponent`.
    pub fn pow(self, mut exponent: u64) -> Self {
        let (mut power, mut base) = (Self::ONE, self);
        while exponent > 0 {
            if exponent & 1 == 1 {
                power *= base;
            }
            base *= base;
            exponent >>= 1;
        }
        power
    }

    /// `Σ weights · values`, of as many as the shorter list has.
    #[inline(always)]
    pub fn dot(weights: &[Self], values: &[Goldilocks]) -> Self {
        Self::dot_of(weights, values.iter().copied())
    }

    /// `Σ a · b`, of as many as there are of both.
    #[inline(always)]
    pub fn dot_of_extensions(a: &[Self], b: &[Self]) -> Self {
        let [mut constant, mut square, mut linear] = [Products::default(); 3];
        for (a, b) in a.iter().zip(b) {
            constant.add(a.0[0], b.0[0]);
            square.add(a.0[1], b.0[1]);
            linear.add(a.0[0], b.0[1]);
            linear.add(a.0[1], b.0[0]);
        }
        let [constant, square, linear] = [constant, square, linear].map(Products::reduce);
        Self([constant + SQUARE * square, linear])
    }

    /// `Σ weights · values`, of as many as there are of both.
    #[inline(always)]
    pub fn dot_of(weights: &[Self], values: impl Iterator<Item = Goldilocks>) -> Self {
        let mut sums = [Products::default(); 2];
        for (weight, value) in weights.iter().zip(values) {
            sums[0].add(weight.0[0], value);
            sums[1].add(weight.0[1], value);
        }
        Self(sums.map(Products::reduce))
    }
}

impl From<Goldilocks> for Extension {
    #[inline(always)]
    fn from(value: Goldilocks) -> Self {
        Self([value, Goldilocks::ZERO])
    }
}

impl Add for Extension {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self([self.0[0] + other.0[0], self.0[1] + other.0[1]])
    }
}

impl Sub for Extension {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self([self.0[0] - other.0[0], self.0[1] - other.0[1]])
    }
}

impl Neg for Extension {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(Neg::neg))
    }
}

impl Mul for Extension {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        #[cfg(feature = "prove")]
        return Self(super::coefficients::multiply(self.0, other.0));
        #[cfg(not(feature = "prove"))]
        {
            let ([a0, a1], [b0, b1]) = (self.0, other.0);
            // A product and seven times an element stay below 2^128.
            let square = (a1 * b1).value() as u128 * SQUARE.value() as u128;
            let even = a0.value() as u128 * b0.value() as u128 + square;
            let [one, other] =
                [(a0, b1), (a1, b0)].map(|(a, b)| a.value() as u128 * b.value() as u128);
            let (odd, carry) = one.overflowing_add(other);
            // 2^128 = −2^32 in the field. After a carry the sum is below (p − 1)², so that this does not carry again.
            let odd = if carry {
                odd + (P as u128 - (1 << 32))
            } else {
                odd
            };
            Self([reduce(even), reduce(odd)])
        }
    }
}

impl AddAssign for Extension {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Extension {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl MulAssign for Extension {
    #[inline(always)]
    fn mul_assign(&mut self, other: Self) {
        *self = *self * other;
    }
}

impl Sum for Extension {
    fn sum<I: Iterator<Item = Self>>(values: I) -> Self {
        values.fold(Self::ZERO, Add::add)
    }
}
