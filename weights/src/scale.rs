//! The scale of a tensor: the fraction bits of its int16 values.
//!
//! **A tensor has exactly one scale**: the most fraction bits within its limits at which the largest magnitude rounds to at most 32767.
//! `zk0_circuits` quantises float32 weights by this rule. For integers, the scale is right if it is the limit, or if a magnitude is at
//! least 16384. Otherwise the same weights would have several files, and a copied update could hide behind another scale.
//!
//! Exact numbers are in units of 2^−24, the most fraction bits of a tensor: every weight is an integer below 2^39 in magnitude.

use crate::error::WeightFileError;
use crate::rounding::{rounded, Unit, MAX_MAGNITUDE};
use zk0_circuits::model::layout::MAX_WEIGHT_BITS;

pub use crate::rounding::exact;

/// A tensor with its scale.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ScaledTensor {
    /// The values, row-major.
    pub values: Vec<i16>,
    /// Their fraction bits.
    pub bits: i16,
}

/// Checks that a tensor has its one scale within `limits`.
///
/// # Errors
/// The scale is wrong, or a value is −32768.
pub fn check(
    name: &str,
    values: &[i16],
    bits: i16,
    limits: (i16, i16),
) -> Result<(), WeightFileError> {
    check_limits(name, bits, limits)?;
    if let Some(index) = values.iter().position(|value| *value == i16::MIN) {
        let name = name.into();
        return Err(WeightFileError::TooLarge { name, index });
    }
    let largest = values.iter().map(|value| value.unsigned_abs()).max();
    match largest.unwrap_or(0) {
        largest if bits < limits.1 && 2 * largest <= MAX_MAGNITUDE => {
            Err(WeightFileError::CoarseScale {
                name: name.into(),
                bits,
                largest,
            })
        }
        _ => Ok(()),
    }
}

/// Checks that a scale is within its limits.
///
/// # Errors
/// It is not.
pub fn check_limits(
    name: &str,
    bits: i16,
    (least, most): (i16, i16),
) -> Result<(), WeightFileError> {
    if (least..=most).contains(&bits) {
        Ok(())
    } else {
        Err(WeightFileError::Scale {
            name: name.into(),
            bits,
            least,
            most,
        })
    }
}

/// A value with `from` fraction bits, rounded to `to`, ties to even. It may exceed int16.
pub fn rescaled(value: i16, from: i16, to: i16) -> i64 {
    let divisor = 1i128 << (MAX_WEIGHT_BITS - to).max(0);
    rounded(exact(value, from).into(), divisor) as i64
}

/// Rounds the fractions `numerators / divisor`, in units of 2^−24, to their one scale within `limits`; ties to even. Values too large for
/// the limits become ±32767; a mean always fits.
///
/// The numerators are below 2^126 in magnitude, and the divisor is at least 1 and below 2^100.
pub fn narrowed(numerators: &[i128], divisor: i128, limits: (i16, i16)) -> ScaledTensor {
    let unit = Unit {
        bits: MAX_WEIGHT_BITS,
        divisor,
    };
    let largest = numerators.iter().map(|one| one.unsigned_abs()).max();
    let largest = largest.unwrap_or(0);
    let bits = unit.scale(largest, limits);
    let mut bytes = vec![0; 2 * numerators.len()];
    unit.to(bits).write(numerators, largest, &mut bytes);
    let pairs = bytes.as_chunks::<2>().0.iter();
    ScaledTensor {
        values: pairs.map(|pair| i16::from_le_bytes(*pair)).collect(),
        bits,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_at_another_scale_is_the_same_number_or_the_nearest() {
        assert_eq!(rescaled(5, 3, 5), 20);
        assert_eq!(rescaled(20, 5, 3), 5);
        assert_eq!(rescaled(6, 3, 1), 2, "1.5 is a tie");
        assert_eq!(rescaled(-6, 3, 1), -2);
        assert_eq!(rescaled(10, 3, 1), 2, "2.5 is a tie");
        assert_eq!(rescaled(i16::MAX, 0, 24), 32767 << 24);
    }

    #[test]
    fn the_largest_magnitude_decides_the_scale() {
        let of = |values: &[i128], divisor| narrowed(values, divisor, (3, 10));
        // One step at the most bits.
        let step = 1 << 14;
        assert_eq!(of(&[0, step], 1).bits, 10);
        assert_eq!(of(&[0, step], 1).values, [0, 1]);
        let largest = 32767 * step;
        assert_eq!(of(&[largest, -largest], 1).values, [32767, -32767]);
        assert_eq!(of(&[largest, -largest], 1).bits, 10);
        // Half a step more rounds to 32768.
        let coarser = of(&[largest + step / 2, step], 1);
        assert_eq!((coarser.bits, &coarser.values[..]), (9, &[16384, 0][..]));
        assert_eq!(of(&[3 * largest], 3).values, [32767]);
        assert_eq!(of(&[], 1).bits, 10);
    }

    /// Also at the limits.
    #[test]
    fn what_is_rounded_has_its_one_scale() {
        let limits = (2, 7);
        let most = 32767i128 << 22;
        let mut state = 7u64;
        for round in 0..20_000u32 {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(round.into());
            let divisor = 1 + i128::from(state % 9);
            let numerator = (i128::from(state >> 16) % (most * divisor + 1)) >> (round % 40);
            let tensor = narrowed(&[numerator, 0], divisor, limits);
            let checked = check("t", &tensor.values, tensor.bits, limits);
            assert_eq!(checked, Ok(()), "{numerator}/{divisor}");
        }
        let tensor = narrowed(&[most * 5], 5, limits);
        assert_eq!((tensor.bits, &tensor.values[..]), (2, &[32767][..]));
    }

    #[test]
    fn another_scale_than_the_one_is_refused_by_name() {
        let refused = |values: &[i16], bits| {
            let error = check("gain", values, bits, (3, 10))
                .unwrap_err()
                .to_string();
            assert!(error.contains("'gain'"), "{error}");
            error
        };
        assert!(check("gain", &[1, -3], 10, (3, 10)).is_ok());
        assert!(check("gain", &[16384], 9, (3, 10)).is_ok());
        assert!(
            refused(&[-16383], 9).contains("9 fraction bits, but its largest magnitude is 16383")
        );
        assert!(refused(&[0], 3).contains("largest magnitude is 0"));
        assert!(refused(&[1], 11).contains("11 fraction bits; it must have 3 to 10"));
        assert!(refused(&[20_000], 2).contains("it must have 3 to 10"));
        assert!(refused(&[0, i16::MIN], 9).contains("-32768 at element 1"));
    }
}
