//! Sums of all numerators and denominators with weights, over one half of their variables.

use crate::field::{Extension, Goldilocks};
use crate::fractions::leaves::{FractionBuffer, Leaves};
use crate::multilinear::eq_table;
use rayon::prelude::*;

/// Rows that one core adds at a time.
const ROWS: usize = 1 << 6;

/// For each index of the `low` lower variables the sum over the higher ones, which have weights `eq(high, index)`: of the numerators, and of the
/// denominators. Fractions after the last one are 0/1.
pub fn over_high(
    leaves: &impl Leaves<Numerator = Goldilocks>,
    low: usize,
    high: &[Extension],
) -> [Vec<Extension>; 2] {
    let weights = eq_table(high);
    let width = 1 << low;
    let used = leaves.len().div_ceil(width);
    let zero = || [vec![Extension::ZERO; width], vec![Extension::ZERO; width]];
    let blocks = weights[..used].par_chunks(ROWS).enumerate();
    let sums = blocks.map_init(FractionBuffer::default, |block, (number, weights)| {
        let [mut numerators, mut denominators] = zero();
        for (row, &weight) in weights.iter().enumerate() {
            let (p, q) = block.read(leaves, (number * ROWS + row) * width, width);
            for (sum, &p) in numerators.iter_mut().zip(p) {
                *sum += weight.scale(p);
            }
            for (sum, &q) in denominators.iter_mut().zip(q) {
                *sum += weight * q;
            }
        }
        [numerators, denominators]
    });
    let mut sums = sums.reduce(zero, |mut a, b| {
        for (a, b) in a.iter_mut().zip(b) {
            for (a, b) in a.iter_mut().zip(b) {
                *a += b;
            }
        }
        a
    });
    let unused: Extension = weights[used..].iter().copied().sum();
    sums[1].iter_mut().for_each(|sum| *sum += unused);
    sums
}

/// For each index of the higher variables the sum over the lower ones, which have weights `eq(low, index)`. There are `variables` in all.
pub fn over_low(
    leaves: &impl Leaves<Numerator = Goldilocks>,
    low: &[Extension],
    variables: usize,
) -> [Vec<Extension>; 2] {
    let weights = eq_table(low);
    let rows = 1usize << (variables - low.len());
    let used = leaves.len().div_ceil(weights.len());
    let sums = (0..used)
        .into_par_iter()
        .map_init(FractionBuffer::default, |block, row| {
            let (p, q) = block.read(leaves, row * weights.len(), weights.len());
            let denominator = weights.iter().zip(q).map(|(&weight, &q)| weight * q);
            (Extension::dot(&weights, p), denominator.sum::<Extension>())
        });
    let (mut numerators, mut denominators): (Vec<_>, Vec<_>) = sums.unzip();
    numerators.resize(rows, Extension::ZERO);
    denominators.resize(rows, Extension::ONE);
    [numerators, denominators]
}
