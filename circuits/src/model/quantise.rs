//! Quantising: from f32 to int16 with a power-of-two scale. Weights and samples are quantised by the same rules.

use crate::model::spec::SpecError;
use alloc::string::String;

/// Why weights cannot be quantised.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum QuantiseError {
    /// A tensor is not there.
    #[error("tensor {0} is missing")]
    Missing(String),
    /// A tensor has the wrong size.
    #[error("tensor {name} has {found} values; {expected} are needed")]
    Length {
        /// Which.
        name: String,
        /// Values needed.
        expected: usize,
        /// Values there.
        found: usize,
    },
    /// A value is NaN or infinite.
    #[error("{name}[{index}] is {value}: weights and samples must be finite")]
    NotFinite {
        /// Which tensor.
        name: String,
        /// Flat index.
        index: usize,
        /// The value.
        value: f32,
    },
    /// A value does not fit int16 at its scale.
    #[error(
        "{name}[{index}] = {value} does not fit: the largest magnitude at this scale is {limit}"
    )]
    TooLarge {
        /// Which tensor.
        name: String,
        /// Flat index.
        index: usize,
        /// The value.
        value: f32,
        /// Largest magnitude that fits.
        limit: f32,
    },
    /// A sample's pad mask is out of order.
    #[error("the sample's pad mask is out of order: a sample has at least one real frame, and padding only after the last one")]
    PadOrder,
    /// The specification is not valid.
    #[error(transparent)]
    Spec(#[from] SpecError),
}

/// Returns a tensor's fraction bits: the most within `limits` at which its largest magnitude fits int16.
pub(crate) fn weight_bits(
    name: &str,
    values: &[f32],
    limits: (i16, i16),
) -> Result<i16, QuantiseError> {
    let mut largest = (0, 0f32);
    for (index, &value) in values.iter().enumerate() {
        if !value.is_finite() {
            return Err(QuantiseError::NotFinite {
                name: name.into(),
                index,
                value,
            });
        }
        if value.abs() > largest.1.abs() {
            largest = (index, value);
        }
    }
    let (index, value) = largest;
    (limits.0..=limits.1)
        .rev()
        .find(|&bits| fixed(value, bits as u32).is_some())
        .ok_or(QuantiseError::TooLarge {
            name: name.into(),
            index,
            value,
            limit: 32767.0 / (1u64 << limits.0) as f32,
        })
}

/// Quantises `source` with `bits` fraction bits into `target`, which is as long.
pub(crate) fn quantise_into(
    name: &str,
    source: &[f32],
    bits: u32,
    target: &mut [i16],
) -> Result<(), QuantiseError> {
    for (index, (&value, target)) in source.iter().zip(target).enumerate() {
        if !value.is_finite() {
            return Err(QuantiseError::NotFinite {
                name: name.into(),
                index,
                value,
            });
        }
        *target = fixed(value, bits).ok_or_else(|| QuantiseError::TooLarge {
            name: name.into(),
            index,
            value,
            limit: 32767.0 / (1u64 << bits) as f32,
        })?;
    }
    Ok(())
}

/// Returns `value · 2^bits` rounded to the nearest integer, ties to even; `None` beyond ±32767.
///
/// The result is the same on every machine: the product by a power of two is exact in f64, and adding and subtracting 1.5 · 2^52 rounds.
fn fixed(value: f32, bits: u32) -> Option<i16> {
    const ROUND: f64 = 6755399441055744.0;
    let scaled = value as f64 * (1u64 << bits) as f64;
    if scaled.abs() > 40000.0 {
        return None;
    }
    let rounded = (scaled + ROUND) - ROUND;
    (rounded.abs() <= 32767.0).then_some(rounded as i16)
}
