//! The field of integers modulo p = 2^64 − 2^32 + 1.
//!
//! An element is a `u64` below p: its *canonical* value, which is also what is hashed and what a proof holds. `p3-goldilocks` has the same
//! field for vector instructions, and a test compares the two.

use bytemuck::TransparentWrapper;
use core::fmt;
#[cfg(feature = "prove")]
use core::hint::select_unpredictable;
use core::iter::Sum;
use core::ops::{Add, AddAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// The modulus.
pub const P: u64 = 0xffff_ffff_0000_0001;
/// 2^64 mod p.
const EPSILON: u64 = 0xffff_ffff;
/// The multiplicative group has a subgroup of order 2^32.
pub const TWO_ADICITY: u32 = 32;
/// A generator of the multiplicative group.
const GENERATOR: Goldilocks = Goldilocks(7);

/// An element of the field.
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
#[repr(transparent)]
pub struct Goldilocks(u64);

// SAFETY: an element is a u64 and nothing else, whatever the value.
unsafe impl TransparentWrapper<u64> for Goldilocks {}

/// `condition`, for which the guest takes a branch: a jump costs it one cycle, where a result that is masked out costs four.
#[inline(always)]
const fn branch(condition: bool) -> bool {
    #[cfg(target_os = "zkvm")]
    if condition {
        core::hint::cold_path();
    }
    condition
}

/// `value` mod p, of 2^128 values.
///
/// 2^64 = 2^32 − 1 and 2^96 = −1 in the field.
#[cfg(not(feature = "prove"))]
#[inline(always)]
pub(crate) const fn reduce(value: u128) -> Goldilocks {
    let (low, high) = (value as u64, (value >> 64) as u64);
    let (top, middle) = (high >> 32, high & EPSILON);
    let (mut rest, borrow) = low.overflowing_sub(top);
    if branch(borrow) {
        rest -= EPSILON; // After a borrow it is at least 2^64 − 2^32
    }
    let (mut sum, carry) = rest.overflowing_add(middle * EPSILON);
    if branch(carry) {
        sum += EPSILON; // After a carry it is below 2^64 − 2^33 + 1
    }
    Goldilocks::canonical(sum)
}

/// The same natively: without a branch on the carry, which comes half the time, so that a processor cannot predict it.
#[cfg(feature = "prove")]
#[inline(always)]
pub(crate) fn reduce(value: u128) -> Goldilocks {
    let (low, high) = (value as u64, (value >> 64) as u64);
    let (top, middle) = (high >> 32, high & EPSILON);
    let (rest, borrow) = low.overflowing_sub(top);
    let rest = if borrow { rest - EPSILON } else { rest };
    let (sum, carry) = rest.overflowing_add(middle * EPSILON);
    Goldilocks::canonical(select_unpredictable(carry, sum.wrapping_add(EPSILON), sum))
}

impl Goldilocks {
    /// Zero.
    pub const ZERO: Self = Self(0);
    /// One.
    pub const ONE: Self = Self(1);

    /// Brings `value` below p.
    #[inline(always)]
    pub(crate) const fn canonical(value: u64) -> Self {
        Self(if branch(value >= P) { value - P } else { value })
    }

    /// The element that `value` stands for. It has to be below 2^63 in magnitude, as every i64 is.
    #[inline(always)]
    pub const fn from_i64(value: i64) -> Self {
        Self(if value < 0 {
            P.wrapping_add(value as u64)
        } else {
            value as u64
        })
    }

    /// The element that `value` stands for.
    #[inline(always)]
    pub const fn from_u32(value: u32) -> Self {
        Self(value as u64)
    }

    /// The element whose canonical value this is; `None` if it is not below p.
    #[inline(always)]
    pub const fn from_canonical(value: u64) -> Option<Self> {
        if value < P {
            Some(Self(value))
        } else {
            None
        }
    }

    /// The elements whose canonical values `words` are, or the place of the first word that is not below p.
    #[inline(always)]
    pub fn of_words(words: &[u64]) -> Result<&[Self], usize> {
        // The place is looked for in the rare case that there is one.
        let wrong = words.iter().fold(false, |wrong, &word| wrong | (word >= P));
        if wrong {
            Err(words.iter().position(|&word| word >= P).unwrap_or_default())
        } else {
            Ok(Self::wrap_slice(words))
        }
    }

    /// The canonical value.
    #[inline(always)]
    pub const fn value(self) -> u64 {
        self.0
    }

    /// `self / 2`.
    pub const fn halved(self) -> Self {
        let half = self.0 / 2;
        Self(if self.0 & 1 == 1 {
            half + P / 2 + 1
        } else {
            half
        })
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

    /// 1/self, and 0 for 0.
    pub fn inverse(self) -> Self {
        self.pow(P - 2)
    }

    /// A generator of the subgroup of order 2^`bits`, for `bits` up to [`TWO_ADICITY`].
    pub fn root_of_unity(bits: u32) -> Self {
        GENERATOR.pow((P - 1) >> bits)
    }
}

impl fmt::Debug for Goldilocks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl From<i16> for Goldilocks {
    #[inline(always)]
    fn from(value: i16) -> Self {
        Self::from_i64(value as i64)
    }
}

impl Add for Goldilocks {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        #[cfg(feature = "prove")]
        return self - Self(P - other.0);
        #[cfg(not(feature = "prove"))]
        {
            let (sum, carry) = self.0.overflowing_add(other.0);
            // With a carry, the sum of two values below p stays below 2^64 − 2^33 + 2.
            Self::canonical(if branch(carry) { sum + EPSILON } else { sum })
        }
    }
}

impl Sub for Goldilocks {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let (difference, borrow) = self.0.overflowing_sub(other.0);
        // Natively without a branch, as in `reduce`.
        #[cfg(feature = "prove")]
        return Self(select_unpredictable(
            borrow,
            difference.wrapping_add(P),
            difference,
        ));
        #[cfg(not(feature = "prove"))]
        Self(if branch(borrow) {
            difference.wrapping_add(P)
        } else {
            difference
        })
    }
}

impl Neg for Goldilocks {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::ZERO - self
    }
}

impl Mul for Goldilocks {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        reduce(self.0 as u128 * other.0 as u128)
    }
}

impl AddAssign for Goldilocks {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Goldilocks {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl MulAssign for Goldilocks {
    #[inline(always)]
    fn mul_assign(&mut self, other: Self) {
        *self = *self * other;
    }
}

impl Sum for Goldilocks {
    fn sum<I: Iterator<Item = Self>>(values: I) -> Self {
        values.fold(Self::ZERO, Add::add)
    }
}

/// A sum of products that is reduced once. It holds up to 2^32 products.
#[derive(Clone, Copy, Default)]
pub struct Products {
    sum: u128,
    /// How often `sum` went past 2^128.
    carries: u64,
}

impl Products {
    /// Adds `a · b`.
    #[inline(always)]
    pub fn add(&mut self, a: Goldilocks, b: Goldilocks) {
        let (sum, carry) = self.sum.overflowing_add(a.0 as u128 * b.0 as u128);
        self.sum = sum;
        self.carries += carry as u64;
    }

    /// The sum as an element. 2^128 = −2^32 in the field.
    #[inline(always)]
    pub fn reduce(self) -> Goldilocks {
        reduce(self.sum) - Goldilocks::canonical(self.carries << 32)
    }
}
