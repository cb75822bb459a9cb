//! How exact fractions become int16 values: the only place that rounds.
//!
//! A [`Unit`] gives the meaning of an integer. A [`Rounding`] divides such integers to the nearest int16 at a scale, ties to even. For
//! small integers, the division becomes a multiplication in vector instructions, with the same results.

use zk0_circuits::model::layout::MAX_WEIGHT_BITS;

pub(crate) const MAX_MAGNITUDE: u16 = i16::MAX as u16;

/// The unit of integers: `n` stands for `n / (divisor · 2^bits)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unit {
    /// Fraction bits, 0 to 24.
    pub bits: i16,
    /// At least 1, and below 2^100.
    pub divisor: i128,
}

impl Unit {
    /// The scale of a tensor whose largest magnitude is `largest`, below 2^(102 + [`Self::bits`]): the most fraction bits within `limits`
    /// at which it rounds to at most 32767. If none fits, it is the least, and [`Rounding::write`] turns larger values into ±32767.
    pub fn scale(&self, largest: u128, (least, most): (i16, i16)) -> i16 {
        let largest = largest as i128;
        let fits = |bits: &i16| self.to(*bits).exactly(largest) <= i128::from(MAX_MAGNITUDE);
        (least..=most).rev().find(fits).unwrap_or(least)
    }

    /// The rounding to `bits` fraction bits.
    pub fn to(&self, bits: i16) -> Rounding {
        let up = (bits - self.bits).max(0) as u32;
        let down = (self.bits - bits).max(0) as u32;
        Rounding {
            up,
            divisor: self.divisor << down,
        }
    }
}

/// A division with ties to even.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rounding {
    /// The power of two that multiplies first.
    up: u32,
    divisor: i128,
}

/// Integers that a [`Rounding`] takes.
pub trait Rounded: Copy {
    /// Rounds `numbers`, at most `largest` in magnitude, to little-endian int16.
    fn round(rounding: &Rounding, numbers: &[Self], largest: u128, out: &mut [u8]);
}

impl Rounding {
    /// As [`Rounded::round`]. What does not fit becomes ±32767.
    pub fn write<T: Rounded>(&self, numbers: &[T], largest: u128, out: &mut [u8]) {
        T::round(self, numbers, largest, out);
    }

    /// It may exceed int16.
    pub(crate) fn exactly(&self, number: i128) -> i128 {
        rounded(number << self.up, self.divisor)
    }

    fn value(&self, number: i128) -> i16 {
        let most = i128::from(MAX_MAGNITUDE);
        self.exactly(number).clamp(-most, most) as i16
    }

    /// The divisor, if it and all numbers up to `largest` are below 2^`bits`.
    fn below(&self, largest: u128, bits: u32) -> Option<u64> {
        let fits = largest < 1 << bits && largest << self.up < 1 << bits;
        (fits && self.divisor < 1 << bits).then_some(self.divisor as u64)
    }
}

impl Rounded for i128 {
    fn round(rounding: &Rounding, numbers: &[Self], _: u128, out: &mut [u8]) {
        write(numbers, out, |number| rounding.value(number));
    }
}

impl Rounded for i64 {
    fn round(rounding: &Rounding, numbers: &[Self], largest: u128, out: &mut [u8]) {
        let Some(divisor) = rounding.below(largest, 62) else {
            return write(numbers, out, |number| rounding.value(number.into()));
        };
        write(numbers, out, |number| {
            let magnitude = number.unsigned_abs() << rounding.up;
            let (below, rest) = (magnitude / divisor, magnitude % divisor);
            let up = 2 * rest > divisor || (2 * rest == divisor && below & 1 == 1);
            let value = (below + u64::from(up)).min(MAX_MAGNITUDE.into()) as i16;
            if number < 0 {
                -value
            } else {
                value
            }
        });
    }
}

impl Rounded for i32 {
    fn round(rounding: &Rounding, numbers: &[Self], largest: u128, out: &mut [u8]) {
        let Some(divisor) = rounding.below(largest, 31) else {
            return write(numbers, out, |number| rounding.value(number.into()));
        };
        // With 2^k at least the divisor, ⌊n / divisor⌋ is ⌊n · m / 2^(31 + k)⌋ for n below 2^31 (Granlund and Montgomery, 1994).
        let shift = 31 + (divisor - 1).checked_ilog2().map_or(0, |log| log + 1);
        let multiplier = ((1u64 << shift) / divisor + 1) as u32;
        let (up, divisor) = (rounding.up, divisor as u32);
        write(numbers, out, |number| {
            let magnitude = number.unsigned_abs() << up;
            let below = ((u64::from(magnitude) * u64::from(multiplier)) >> shift) as u32;
            let twice = 2 * (magnitude - below * divisor);
            let tie_to_even = (twice == divisor) & (below & 1 == 1);
            let value = below + u32::from((twice > divisor) | tie_to_even);
            let value = value.min(MAX_MAGNITUDE.into()) as i32;
            let sign = number >> 31;
            ((value ^ sign) - sign) as i16
        });
    }
}

fn write<T: Copy>(numbers: &[T], out: &mut [u8], value: impl Fn(T) -> i16) {
    for (out, number) in out.as_chunks_mut::<2>().0.iter_mut().zip(numbers) {
        *out = value(*number).to_le_bytes();
    }
}

/// A value with `bits` fraction bits, at most 24, in units of 2^−24.
pub fn exact(value: i16, bits: i16) -> i64 {
    i64::from(value) << (MAX_WEIGHT_BITS - bits).max(0)
}

/// Divides by a positive number, with ties to even.
pub(crate) fn rounded(numerator: i128, divisor: i128) -> i128 {
    let (below, rest) = (numerator.div_euclid(divisor), numerator.rem_euclid(divisor));
    let up = match (2 * rest).cmp(&divisor) {
        std::cmp::Ordering::Less => 0,
        std::cmp::Ordering::Equal => below & 1,
        std::cmp::Ordering::Greater => 1,
    };
    below + up
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn halves_are_rounded_to_even() {
        for (numerator, divisor, expected) in [
            (1, 2, 0),
            (3, 2, 2),
            (5, 2, 2),
            (-1, 2, 0),
            (-3, 2, -2),
            (-5, 2, -2),
            (7, 4, 2),
            (-7, 4, -2),
            (5, 3, 2),
            (4, 3, 1),
            (-4, 3, -1),
        ] {
            assert_eq!(
                rounded(numerator, divisor),
                expected,
                "{numerator}/{divisor}"
            );
        }
    }

    #[test]
    fn what_is_too_large_for_the_least_scale_is_the_largest_value() {
        let unit = Unit {
            bits: 4,
            divisor: 3,
        };
        let numbers = [i64::from(i32::MAX), 0, -i64::from(i32::MAX)];
        let largest = i32::MAX as u128;
        assert_eq!(unit.scale(largest, (2, 10)), 2);
        let rounding = unit.to(2);
        let all = [
            written(&rounding, &numbers.map(|one| one as i32), largest),
            written(&rounding, &numbers, largest),
            written(&rounding, &numbers.map(i128::from), largest),
        ];
        assert_eq!(all, [[32767, 0, -32767]; 3]);
    }

    fn written<T: Rounded>(rounding: &Rounding, numbers: &[T], largest: u128) -> Vec<i16> {
        let mut out = vec![0; 2 * numbers.len()];
        rounding.write(numbers, largest, &mut out);
        let pairs = out.as_chunks::<2>().0.iter();
        pairs.map(|pair| i16::from_le_bytes(*pair)).collect()
    }

    proptest! {
        /// Also at ties and limits.
        #[test]
        fn all_integers_are_rounded_alike(
            seeds in prop::collection::vec((any::<i32>(), 0u32..32, any::<bool>()), 1..40),
            divisor in (1u32..1 << 31, 0u32..31),
            bits in (0i16..=24, 0i16..=24),
        ) {
            let divisor = i128::from((divisor.0 >> divisor.1).max(1));
            let rounding = Unit { bits: bits.0, divisor }.to(bits.1);
            let numbers: Vec<i32> = seeds.iter().map(|&(number, shift, tie)| {
                let number = number.max(-i32::MAX) >> shift.min(31);
                // Ties are halves of the divisor.
                if tie { (i128::from(number) * rounding.divisor / 2).clamp(-(1 << 30), 1 << 30) as i32 } else { number }
            }).collect();
            let largest = numbers.iter().map(|one| u128::from(one.unsigned_abs())).max().unwrap();
            let wide: Vec<_> = numbers.iter().map(|one| i128::from(*one)).collect();
            let expected = written(&rounding, &wide, largest);
            prop_assert_eq!(&written(&rounding, &numbers, largest), &expected);
            let longer: Vec<_> = numbers.iter().map(|one| i64::from(*one)).collect();
            prop_assert_eq!(&written(&rounding, &longer, largest), &expected);
        }
    }
}
