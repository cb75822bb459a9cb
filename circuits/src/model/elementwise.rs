//! What the evaluation does between products: norms, rotations, activations, softmax. Results are int16. Every narrowing is a
//! shift that rounds half up. If its result does not fit, the evaluation fails and names the site, or the result is the nearest value that fits.

use crate::model::arithmetic::fixed::{integer_sqrt, round_shift, saturated, Range, Rescale};
use crate::model::arithmetic::products::dot;
use crate::model::arithmetic::tables;
use crate::model::linear::output;
use crate::model::multiply::ATTENTION_BITS;
use crate::model::site::{EvalError, Narrowing, Overflow, Site};
use crate::vm::budget::operation;
use alloc::vec::Vec;

/// Appends `values` to `target` as int16.
#[inline(always)]
fn narrow(
    at: Narrowing,
    values: impl Iterator<Item = i64> + Clone,
    target: &mut Vec<i16>,
) -> Result<(), EvalError> {
    let first = target.len();
    let mut range = Range::default();
    target.extend(values.clone().map(|value| range.narrow(value)));
    if !range.holds() {
        again(at, values.zip(&mut target[first..]))?;
    }
    Ok(())
}

/// Narrows values of which one does not fit.
#[cold]
fn again<'t>(
    at: Narrowing,
    values: impl Iterator<Item = (i64, &'t mut i16)>,
) -> Result<(), EvalError> {
    for (value, target) in values {
        *target = saturated(value);
        if *target as i64 != value {
            at.overflown(value)?;
        }
    }
    Ok(())
}

/// Does what [`narrow`] does, into a new vector.
#[inline(always)]
fn narrowed(
    at: Narrowing,
    values: impl Iterator<Item = i64> + Clone,
) -> Result<Vec<i16>, EvalError> {
    let mut target = Vec::with_capacity(values.size_hint().0);
    narrow(at, values, &mut target)?;
    Ok(target)
}

/// `x_t = t · noise + (1 − t) · action`, `time` in units of 2^-16.
pub fn noised(time: u16, noise: &[i16], actions: &[i16]) -> Result<Vec<i16>, EvalError> {
    let time = time as i64;
    let values = noise.iter().zip(actions).map(|(&noise, &action)| {
        let sum = time * noise as i64 + (65536 - time) * action as i64;
        round_shift(sum, 16)
    });
    let (site, overflow) = (Site::NoisedAction, Overflow::Refused);
    narrowed(Narrowing { site, overflow }, values)
}

/// The outputs of sums.
pub fn outputs(sums: &[i32]) -> impl Iterator<Item = i16> + '_ {
    sums.iter().map(|&sum| output(sum) as i16)
}

/// RMSNorm with eps 1e-5 over rows of the gain's width: `x · gain / √(mean(x²) + eps)`, with one reciprocal per row. `input`
/// has `bits` fraction bits, and the result has `out`.
pub fn norm(
    at: Narrowing,
    input: &[i16],
    bits: u8,
    (gain, gain_bits): (&[i16], i16),
    out: u8,
) -> Result<Vec<i16>, EvalError> {
    let _operation = operation("norms");
    /// 1e-5 with 32 fraction bits.
    const EPS: u64 = 42_950;
    let width = gain.len() as u64;
    let eps = EPS << (2 * bits as u32);
    // The reciprocal has 23 fraction bits, and x·gain·reciprocal bits + gain_bits + 23.
    let shift = gain_bits as u32 + bits as u32 + 23 - out as u32;
    let mut output = Vec::with_capacity(input.len());
    for row in input.chunks_exact(gain.len()) {
        let squares = dot(row, row) as u64;
        let (whole, rest) = (squares / width, squares % width);
        // Mean square with 2·bits + 32 fraction bits, at most 2^62; its root has bits + 16, and is at least 2^(bits+7).
        let mean = (whole << 32) + (rest << 32) / width;
        let root = integer_sqrt(mean + eps);
        // Below 2^32; |x·gain| ≤ 2^30.
        let reciprocal = ((1u64 << (39 + bits as u32)) / root) as i64;
        let values = row
            .iter()
            .zip(gain)
            .map(|(&x, &gain)| round_shift(x as i64 * gain as i64 * reciprocal, shift));
        narrow(at, values, &mut output)?;
    }
    Ok(output)
}

/// RoPE over sums in rows of heads of `head_dim`. The halves of a head are rotated, those of row `i` by
/// `rotations[i·head_dim/2 ..]`. The head at `(row, head)` goes to `place(row, head)` of `target`.
pub fn rotate(
    at: Narrowing,
    sums: &[i32],
    (width, head_dim): (usize, usize),
    rotations: &[(i16, i16)],
    target: &mut [i16],
    place: impl Fn(usize, usize) -> usize,
) -> Result<(), EvalError> {
    let _operation = operation("rotation");
    let half = head_dim / 2;
    let rows = sums.chunks_exact(width).zip(rotations.chunks_exact(half));
    for (row, (sums, rotations)) in rows.enumerate() {
        for (head, sums) in sums.chunks_exact(head_dim).enumerate() {
            let (a, b) = sums.split_at(half);
            let pairs = a.iter().zip(b).zip(rotations);
            let pairs = pairs.map(|((&a, &b), &(cosine, sine))| {
                let (a, b) = (output(a), output(b));
                let (cosine, sine) = (cosine as i64, sine as i64);
                [
                    round_shift(a * cosine - b * sine, tables::TRIG_BITS),
                    round_shift(b * cosine + a * sine, tables::TRIG_BITS),
                ]
            });
            let mut range = Range::default();
            let (low, high) = target[place(row, head)..][..head_dim].split_at_mut(half);
            for ((low, high), pair) in low.iter_mut().zip(&mut *high).zip(pairs.clone()) {
                [*low, *high] = pair.map(|value| range.narrow(value));
            }
            if !range.holds() {
                let targets = low.iter_mut().zip(high).flat_map(|(low, high)| [low, high]);
                again(at, pairs.flatten().zip(targets))?;
            }
        }
    }
    Ok(())
}

/// The residual stream: outputs of `sums`, which have `out` fraction bits, plus `residual`, which has `bits`.
pub fn add(
    at: Narrowing,
    sums: &[i32],
    residual: &[i16],
    bits: u8,
    out: u8,
) -> Result<Vec<i16>, EvalError> {
    let _operation = operation("residuals");
    let rescale = Rescale::new(bits as i32, out as i32);
    let values = sums
        .iter()
        .zip(residual)
        .map(|(&sum, &residual)| output(sum) + rescale.apply(residual as i64));
    narrowed(at, values)
}

/// SiLU of the outputs of `sums`, which have `bits` ≥ 6 fraction bits; the result has `out` ≤ 15.
pub fn silu(at: Narrowing, sums: &[i32], bits: u8, out: u8) -> Result<Vec<i16>, EvalError> {
    let _operation = operation("SiLU");
    let shift = bits as u32 + tables::SIGMOID_BITS - out as u32;
    let to_logit = tables::LOGIT_BITS - bits as u32;
    let values = sums.iter().map(|&sum| {
        let x = output(sum);
        round_shift(x * tables::sigmoid(x << to_logit), shift)
    });
    narrowed(at, values)
}

/// SwiGLU: `silu(gate) · up`, where the gate has `bits` ≥ 6 fraction bits, the other `up_bits` and the result `out` ≤ 15.
pub fn swiglu(
    at: Narrowing,
    (gate, bits): (&[i32], u8),
    (up, up_bits): (&[i32], u8),
    out: u8,
) -> Result<Vec<i16>, EvalError> {
    let _operation = operation("SiLU");
    let shift = (bits + up_bits) as u32 + tables::SIGMOID_BITS - out as u32;
    let to_logit = tables::LOGIT_BITS - bits as u32;
    let values = gate.iter().zip(up).map(|(&gate, &up)| {
        let gate = output(gate);
        let silu = gate * tables::sigmoid(gate << to_logit);
        round_shift(silu * output(up), shift)
    });
    narrowed(at, values)
}

/// Fraction bits of [`Softmax`]'s factor.
const FACTOR_BITS: i32 = 20;

/// Softmax of a row of scores, by powers of two of the distance to the largest.
#[derive(Clone, Copy)]
pub struct Softmax {
    /// log2(e)/√head_dim with [`FACTOR_BITS`] fraction bits.
    factor: i64,
    /// From a distance times the factor to [`tables::exp2_negative`]'s argument.
    shift: u32,
}

impl Softmax {
    /// For heads of `head_dim`, and scores with `bits` fraction bits.
    pub fn new(head_dim: u32, bits: u32) -> Self {
        /// `log2(e)^2 · 2^(2·FACTOR_BITS)`, rounded.
        const LOG2_E_SQUARED: u64 = 2_288_489_396_308;
        Self {
            factor: integer_sqrt(LOG2_E_SQUARED / head_dim as u64) as i64,
            shift: bits + FACTOR_BITS as u32 - tables::EXPONENT_BITS,
        }
    }

    /// Writes the attention weights of `scores`, with [`ATTENTION_BITS`] fraction bits, into `weights`, which is as long.
    pub fn apply(self, scores: &[i64], weights: &mut [i16]) {
        let largest = scores.iter().fold(i64::MIN, |most, &score| most.max(score));
        // Distance at most 2^40, factor below 2^21.
        let nearest = largest * self.factor + (1 << (self.shift - 1));
        let mut total = 0;
        for (&score, weight) in scores.iter().zip(weights.iter_mut()) {
            let distance = (nearest - score * self.factor) >> self.shift;
            let power = tables::exp2_negative(distance as u64);
            total += power as u64;
            *weight = power as i16; // its 16 bits, until the loop below
        }
        // The largest score's power alone is 2^15: the reciprocal is at most 2^33, a product at most 2^48.
        const RECIPROCAL_BITS: u32 = 48;
        let reciprocal = (1 << RECIPROCAL_BITS) / total.max(1);
        const SHIFT: u32 = RECIPROCAL_BITS - ATTENTION_BITS;
        for weight in weights {
            let power = *weight as u16 as u64;
            *weight = ((power * reciprocal + (1 << (SHIFT - 1))) >> SHIFT) as i16;
        }
    }
}
