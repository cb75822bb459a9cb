//! Rows of codewords at a few positions, without the codewords.
//!
//! 2^m neighbouring leaves hold the values at the points x with one value c of x^(2^m). There, `f(x) = Σ_i x^i · g_i` with
//! `g_i = Σ_k f_(i + 2^m·k) · c^k`: products of a matrix of powers with the values as they lie. They are computed exactly in floating point: powers in
//! digits of 22 bits and values in pieces of 16 bits, so that a sum of 2^15 products is below 2^53.

use super::columns::Column;
use super::encode::Encoder;
use super::matrix::CodeMatrix;
use crate::field::Goldilocks;
use p3_goldilocks::Goldilocks as Theirs;
use rayon::prelude::*;

/// Bits of a power's digits, and how many there are.
const DIGIT: u32 = 22;
const DIGITS: usize = 3;
/// Rows of digits, and values, that are multiplied at once: their products stay in registers.
const ROWS: usize = 4;
const VALUES: usize = 8;
/// Powers after which the next values are read, so that both stay in caches.
const INNER: usize = 1 << 8;
/// Values beside each other that one core multiplies at a time.
const STRIP: usize = 1 << 6;

/// Digits of the powers of one number for each position.
struct Powers {
    /// How many powers of each number.
    count: usize,
    /// Of each [`INNER`] powers, for [`ROWS`] rows after the other.
    digits: Vec<[f64; ROWS]>,
    /// How many numbers, and rows of digits.
    positions: usize,
    rows: usize,
}

impl Powers {
    fn new(bases: &[Goldilocks], count: usize) -> Self {
        let all = bases.par_iter().flat_map_iter(|&base| {
            let mut rows = [(); DIGITS].map(|()| Vec::with_capacity(count));
            let mut power = Goldilocks::ONE;
            for _ in 0..count {
                let mut rest = power.value();
                for row in &mut rows {
                    // Digits are signed, so that the largest magnitude is half as large.
                    let digit = (rest as i64) << (64 - DIGIT) >> (64 - DIGIT);
                    row.push(digit as f64);
                    rest = ((i128::from(rest) - i128::from(digit)) >> DIGIT) as u64;
                }
                power *= base;
            }
            rows
        });
        let all: Vec<Vec<f64>> = all.collect();
        let inner = INNER.min(count);
        let groups = all.chunks(ROWS).len();
        let mut digits = Vec::with_capacity(groups * count);
        for first in (0..count).step_by(inner) {
            for group in all.chunks(ROWS) {
                for number in first..first + inner {
                    let digit = |row: usize| group.get(row).map_or(0.0, |row| row[number]);
                    digits.push(core::array::from_fn(digit));
                }
            }
        }
        Self {
            count,
            digits,
            positions: bases.len(),
            rows: groups * ROWS,
        }
    }

    /// The sums over all powers of their products with values, which are `stride` apart, for [`STRIP`] of them from number `first` on: for each
    /// position one after the other.
    fn products(&self, column: &Column, first: usize, stride: usize) -> Vec<Goldilocks> {
        let width = STRIP.min(stride);
        let tiles = width / VALUES;
        let inner = INNER.min(self.count);
        let mut totals = vec![Goldilocks::ZERO; self.positions * width];
        let mut values = vec![[0.0; VALUES]; tiles * inner];
        for piece in 0..column.pieces() {
            let mut sums = vec![[[0.0; VALUES]; ROWS]; self.rows / ROWS * tiles];
            let blocks = self.digits.chunks_exact(self.rows / ROWS * inner);
            for (block, digits) in blocks.enumerate() {
                let mut row = [0.0; STRIP];
                for number in 0..inner {
                    let start = first + (block * inner + number) * stride;
                    column.piece(piece, start, &mut row[..width]);
                    for (tile, own) in row[..width].as_chunks().0.iter().enumerate() {
                        values[tile * inner + number] = *own;
                    }
                }
                let groups = digits.chunks_exact(inner).zip(sums.chunks_exact_mut(tiles));
                for (digits, sums) in groups {
                    for (sums, values) in sums.iter_mut().zip(values.chunks_exact(inner)) {
                        add_products(digits, values, sums);
                    }
                }
            }
            let sum = |row: usize, at: usize| {
                let tile = row / ROWS * tiles + at / VALUES;
                sums[tile][row % ROWS][at % VALUES]
            };
            let factors: [Goldilocks; DIGITS] = core::array::from_fn(|digit| {
                let bits = piece * i16::BITS + digit as u32 * DIGIT;
                Goldilocks::from_u32(2).pow(bits.into())
            });
            for (number, total) in totals.iter_mut().enumerate() {
                let (position, at) = (number / width, number % width);
                for (digit, &factor) in factors.iter().enumerate() {
                    let own = sum(position * DIGITS + digit, at) as i64;
                    *total += Goldilocks::from_i64(own) * factor;
                }
            }
        }
        totals
    }
}

/// `Σ digits · values`.
fn add_products(
    digits: &[[f64; ROWS]],
    values: &[[f64; VALUES]],
    sums: &mut [[f64; VALUES]; ROWS],
) {
    let mut own = *sums;
    for (digits, values) in digits.iter().zip(values) {
        for (sums, &digit) in own.iter_mut().zip(digits) {
            for (sum, &value) in sums.iter_mut().zip(values) {
                // Both ways are exact. Without such an instruction, the first one is slow.
                *sum = if cfg!(target_feature = "fma") {
                    digit.mul_add(value, *sum)
                } else {
                    digit * value + *sum
                };
            }
        }
    }
    *sums = own;
}

/// For each of these numbers, the rows of a matrix that are at leaves 2^`bits`·number and after it, as many as 2^`bits`, one after the other.
/// There are 2^`length` leaves.
pub fn rows(
    encoder: &Encoder,
    matrix: &CodeMatrix,
    numbers: &[usize],
    (bits, length): (u32, u32),
) -> Vec<Vec<Theirs>> {
    let (stride, width) = (1usize << bits, matrix.width());
    let root = Goldilocks::root_of_unity(length);
    // The first point of each, and the power of it that all have.
    let points = numbers.iter().map(|&number| {
        let reversed = number.reverse_bits() >> (usize::BITS - (length - bits));
        root.pow(reversed as u64)
    });
    let points: Vec<Goldilocks> = points.collect();
    let bases: Vec<Goldilocks> = points
        .iter()
        .map(|point| point.pow(stride as u64))
        .collect();
    let count = matrix.columns[0].len() >> bits;
    let powers = Powers::new(&bases, count);
    let strip = STRIP.min(stride);
    let strips =
        (0..width).flat_map(|column| (0..stride).step_by(strip).map(move |at| (column, at)));
    let strips: Vec<(usize, usize)> = strips.collect();
    let products = strips
        .par_iter()
        .map(|&(column, first)| powers.products(&matrix.columns[column], first, stride));
    let products: Vec<Vec<Goldilocks>> = products.collect();
    let all = points.par_iter().zip(&bases).enumerate();
    let all = all.map(|(position, (&point, base))| {
        let mut coefficients = vec![Theirs::default(); stride * width];
        for (&(column, first), products) in strips.iter().zip(&products) {
            let own = &products[position * strip..][..strip];
            for (at, value) in own.iter().enumerate() {
                coefficients[(first + at) * width + column] = Theirs::new(value.value());
            }
        }
        for (column, tail) in matrix.tails.iter().enumerate() {
            let mut power = base.pow(count as u64);
            for tail in tail.chunks(stride) {
                for (at, &coefficient) in tail.iter().enumerate() {
                    coefficients[at * width + column] += Theirs::new((power * coefficient).value());
                }
                power *= *base;
            }
        }
        encoder.transform(coefficients, width, point)
    });
    all.collect()
}
