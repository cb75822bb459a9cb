//! Projections of the weight matrices. The verifier computes them from the weights, so that the weights need not enter the guest.
//!
//! The projection of a linear layer is `u = Σ 2^shift · Wᵀ·r` over its matrices W, each with its own stretch of the random
//! coefficients r: one field element per input column.

use crate::freivalds::coefficients::{compose, Coefficient, Coefficients};
use crate::freivalds::field::{Element, Limbs};
use crate::model::eval::Evaluator;
use crate::model::linear::Linear;
use crate::model::spec::Dims;
use crate::vm::digest::Digest;
use crate::vm::poseidon2::{hash_words, Domain};
use alloc::vec;
use alloc::vec::Vec;

/// Returns how many coefficients the products of an evaluation take.
pub fn coefficient_count(dims: &Dims, linears: &[Linear]) -> usize {
    let outputs = linears.iter().map(|linear| linear.rows());
    let keys = dims.max_prefix as usize + dims.chunk as usize;
    let attention = keys.max(dims.head_dim as usize);
    outputs.fold(attention, usize::max)
}

/// Returns the number of elements of all projections of one set of weights.
pub fn projection_len(linears: &[Linear]) -> usize {
    linears.iter().map(|linear| linear.columns).sum()
}

/// Returns the projections of all linear layers, one after another. `matrix` returns the values (row-major) and the fraction
/// bits of the tensor with an index.
pub fn project<M: AsRef<[i16]>, E>(
    evaluator: &Evaluator<'_>,
    coefficients: &Coefficients,
    mut matrix: impl FnMut(usize) -> Result<(M, i16), E>,
) -> Result<Vec<Limbs>, E> {
    let mut all = Vec::with_capacity(projection_len(&evaluator.linears));
    for linear in &evaluator.linears {
        let mut sums = vec![Element::ZERO; linear.columns];
        let mut first = 0;
        for output in &linear.outputs {
            let (values, bits) = matrix(output.matrix)?;
            let shift = output.shift(linear.bits, bits);
            let coefficients = coefficients.range(first, output.rows);
            let parts = combine(values.as_ref(), linear.columns, coefficients);
            for (column, sum) in sums.iter_mut().enumerate() {
                let part = parts.each_ref().map(|parts| parts[column] as i128);
                *sum = *sum + compose(part).shift(shift);
            }
            first += output.rows;
        }
        all.extend(sums.iter().map(|sum| sum.limbs()));
    }
    Ok(all)
}

/// Per limb and column, `Σ limb_j · values[j·columns + column]`. It has to fit an int64: |value| ≤ 2^15, and with |limb| ≤ 2^25 it does for
/// 2^22 rows, with |limb| ≤ 2^31 for 2^16.
pub fn combine(values: &[i16], columns: usize, coefficients: &[Coefficient]) -> [Vec<i64>; 4] {
    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    {
        #[target_feature(enable = "avx2")]
        fn with_avx2(values: &[i16], columns: usize, by: &[Coefficient]) -> [Vec<i64>; 4] {
            combine_with(values, columns, by)
        }
        if std::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            return unsafe { with_avx2(values, columns, coefficients) };
        }
    }
    combine_with(values, columns, coefficients)
}

/// [`combine`] in plain Rust, which compilers turn into vector instructions. It takes four rows at a time, so that sums are
/// loaded and stored once for four rows.
#[inline(always)]
fn combine_with(values: &[i16], columns: usize, coefficients: &[Coefficient]) -> [Vec<i64>; 4] {
    let mut sums = [(); 4].map(|()| vec![0i64; columns]);
    let blocks = values.chunks_exact(4 * columns);
    let (fours, rest) = coefficients.as_chunks::<4>();
    let later = &values[(4 * columns * fours.len()).min(values.len())..];
    for (rows, by) in blocks.zip(fours) {
        let (a, rows) = rows.split_at(columns);
        let (b, rows) = rows.split_at(columns);
        let (c, d) = rows.split_at(columns);
        for (limb, sums) in sums.iter_mut().enumerate() {
            let by = by.map(|coefficient| coefficient[limb] as i64);
            let rows = a.iter().zip(b).zip(c).zip(d);
            for (sum, (((&a, &b), &c), &d)) in sums.iter_mut().zip(rows) {
                let (a, b, c, d) = (a as i64, b as i64, c as i64, d as i64);
                *sum += a * by[0] + b * by[1] + c * by[2] + d * by[3];
            }
        }
    }
    for (row, by) in later.chunks_exact(columns).zip(rest) {
        for (sums, &limb) in sums.iter_mut().zip(by) {
            for (sum, &value) in sums.iter_mut().zip(row) {
                *sum += value as i64 * limb as i64;
            }
        }
    }
    sums
}

/// Returns for each linear layer its part of all projections, or `None` if there are not as many as the layers take.
pub fn by_linear<'p>(linears: &[Linear], all: &'p [Limbs]) -> Option<Vec<&'p [Limbs]>> {
    let mut rest = all;
    let mut parts = Vec::with_capacity(linears.len());
    for linear in linears {
        let (part, later) = rest.split_at_checked(linear.columns)?;
        parts.push(part);
        rest = later;
    }
    rest.is_empty().then_some(parts)
}

/// Poseidon2 digest of projections, each limb as four int16.
pub fn digest(projections: &[Limbs]) -> Digest {
    let words = projections.as_flattened();
    hash_words(Domain::Projections, words, 4 * words.len() as u64)
}
