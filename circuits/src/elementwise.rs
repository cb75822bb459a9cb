//! What the evaluation does between products: norms, rotations, activations, softmax. Results are int16; every narrowing
//! is a shift (half up) whose result must fit, or the evaluation fails and names the site.

use crate::{
    fixed::{integer_sqrt, round_shift, Narrow, Rescale},
    linear::output,
    multiply::ATTENTION_BITS,
    parameters::Vector,
    products::dot,
    site::{EvalError, Site},
    tables,
};
use alloc::vec::Vec;

/// Fails with the first value that did not fit, if any.
fn checked(site: Site, narrow: Narrow) -> Result<(), EvalError> {
    match narrow.refused {
        None => Ok(()),
        Some(value) => Err(EvalError::OutOfRange { site, value }),
    }
}

/// `x_t = t · noise + (1 − t) · action`, `time` in units of 2^-16.
pub fn noised(time: u16, noise: &[i16], actions: &[i16]) -> Result<Vec<i16>, EvalError> {
    let time = time as i64;
    let mut narrow = Narrow::new();
    let values = noise.iter().zip(actions).map(|(&noise, &action)| {
        let sum = time * noise as i64 + (65536 - time) * action as i64;
        narrow.narrow(round_shift(sum, 16))
    });
    let values = values.collect();
    checked(Site::NoisedAction, narrow)?;
    Ok(values)
}

/// The outputs of sums.
pub fn outputs(sums: &[i32]) -> impl Iterator<Item = i16> + '_ {
    sums.iter().map(|&sum| output(sum) as i16)
}

/// RMSNorm with eps 1e-5 over rows of the gain's width: `x · gain / √(mean(x²) + eps)`, by a reciprocal per row. `input` has
/// `bits` fraction bits, the result `out`.
pub fn norm(
    site: Site,
    input: &[i16],
    bits: u8,
    gain: Vector<'_>,
    out: u8,
) -> Result<Vec<i16>, EvalError> {
    /// 1e-5 with 32 fraction bits.
    const EPS: u64 = 42_950;
    let width = gain.values.len() as u64;
    let eps = EPS << (2 * bits as u32);
    // The reciprocal has 23 fraction bits, and x·gain·reciprocal bits + gain.bits + 23.
    let shift = gain.bits as u32 + bits as u32 + 23 - out as u32;
    let mut output = Vec::with_capacity(input.len());
    let mut narrow = Narrow::new();
    for row in input.chunks_exact(gain.values.len()) {
        let squares = dot(row, row) as u64;
        let (whole, rest) = (squares / width, squares % width);
        // Mean square with 2·bits + 32 fraction bits, at most 2^62; its root has bits + 16, and is at least 2^(bits+7).
        let mean = (whole << 32) + (rest << 32) / width;
        let root = integer_sqrt(mean + eps);
        // Below 2^32; |x·gain| ≤ 2^30.
        let reciprocal = ((1u64 << (39 + bits as u32)) / root) as i64;
        for (&x, &gain) in row.iter().zip(gain.values) {
            let product = x as i64 * gain as i64 * reciprocal;
            output.push(narrow.narrow(round_shift(product, shift)));
        }
    }
    checked(site, narrow)?;
    Ok(output)
}

/// RoPE over sums in rows of heads of `head_dim`: halves rotated; row `i` by `rotations[i·head_dim/2 ..]`. The head at
/// `(row, head)` goes to `place(row, head)` of `target`.
pub fn rotate(
    site: Site,
    sums: &[i32],
    (width, head_dim): (usize, usize),
    rotations: &[(i16, i16)],
    target: &mut [i16],
    place: impl Fn(usize, usize) -> usize,
) -> Result<(), EvalError> {
    let half = head_dim / 2;
    let mut narrow = Narrow::new();
    let rows = sums.chunks_exact(width).zip(rotations.chunks_exact(half));
    for (row, (sums, rotations)) in rows.enumerate() {
        for (head, sums) in sums.chunks_exact(head_dim).enumerate() {
            let target = &mut target[place(row, head)..][..head_dim];
            let (low, high) = target.split_at_mut(half);
            let (a, b) = sums.split_at(half);
            let inputs = a.iter().zip(b).zip(rotations);
            for (((&a, &b), &(cosine, sine)), (low, high)) in inputs.zip(low.iter_mut().zip(high)) {
                let (a, b) = (output(a), output(b));
                let (cosine, sine) = (cosine as i64, sine as i64);
                *low = narrow.narrow(round_shift(a * cosine - b * sine, tables::TRIG_BITS));
                *high = narrow.narrow(round_shift(b * cosine + a * sine, tables::TRIG_BITS));
            }
        }
    }
    checked(site, narrow)
}

/// The residual stream: outputs of `sums`, which have `out` fraction bits, plus `residual`, which has `bits`.
pub fn add(
    site: Site,
    sums: &[i32],
    residual: &[i16],
    bits: u8,
    out: u8,
) -> Result<Vec<i16>, EvalError> {
    let rescale = Rescale::new(bits as i32, out as i32);
    let mut narrow = Narrow::new();
    let values = sums
        .iter()
        .zip(residual)
        .map(|(&sum, &residual)| narrow.narrow(output(sum) + rescale.apply(residual as i64)));
    let values = values.collect();
    checked(site, narrow)?;
    Ok(values)
}

/// SiLU of the outputs of `sums`, which have `bits` fraction bits; the result has `out`.
pub fn silu(site: Site, sums: &[i32], bits: u8, out: u8) -> Result<Vec<i16>, EvalError> {
    let rescale = Rescale::new(bits as i32 + tables::SIGMOID_BITS as i32, out as i32);
    let to_logit = tables::LOGIT_BITS - bits as u32;
    let mut narrow = Narrow::new();
    let values = sums.iter().map(|&sum| {
        let x = output(sum);
        narrow.narrow(rescale.apply(x * tables::sigmoid(x << to_logit)))
    });
    let values = values.collect();
    checked(site, narrow)?;
    Ok(values)
}

/// SwiGLU: `silu(gate) · up`, where the gate has `bits` fraction bits, the other `up_bits` and the result `out`.
pub fn swiglu(
    site: Site,
    (gate, bits): (&[i32], u8),
    (up, up_bits): (&[i32], u8),
    out: u8,
) -> Result<Vec<i16>, EvalError> {
    let from = (bits + up_bits) as i32 + tables::SIGMOID_BITS as i32;
    let rescale = Rescale::new(from, out as i32);
    let to_logit = tables::LOGIT_BITS - bits as u32;
    let mut narrow = Narrow::new();
    let values = gate.iter().zip(up).map(|(&gate, &up)| {
        let gate = output(gate);
        let silu = gate * tables::sigmoid(gate << to_logit);
        narrow.narrow(rescale.apply(silu * output(up)))
    });
    let values = values.collect();
    checked(site, narrow)?;
    Ok(values)
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

    /// Attention weights of `scores`, with [`ATTENTION_BITS`] fraction bits, into `weights`, which is as long.
    pub fn apply(self, scores: &[i32], weights: &mut [i16]) {
        let largest = scores.iter().fold(i32::MIN, |most, &score| most.max(score)) as i64;
        let mut total = 0;
        for (&score, weight) in scores.iter().zip(weights.iter_mut()) {
            // Distance below 2^33, factor below 2^21.
            let distance = round_shift((largest - score as i64) * self.factor, self.shift);
            let power = tables::exp2_negative(distance as u64);
            total += power as u64;
            *weight = power as i16; // its 16 bits, for the moment
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
