//! The random coefficients of the product checks, expanded from a seed, and inner products with them.
//!
//! A coefficient is `Σ limb_k · 2^(26k)` with four limbs in −2^25 .. 2^25. Each limb is the low 26 bits of one KoalaBear element
//! squeezed from Poseidon2, less 2^25. At most 32 of the field's 2^31 − 2^24 + 1 elements share their low 26 bits, so that no
//! coefficient has a probability above 2^-103.9.

use crate::freivalds::field::{Element, Limbs, LIMB_BITS};
use crate::model::arithmetic::products::Rows;
use crate::vm::digest::Digest;
use crate::vm::poseidon2::{Domain, Squeeze};
use alloc::vec::Vec;

/// Bits of a coefficient's limb.
const BITS: u32 = 26;

/// The four limbs of a coefficient.
pub type Coefficient = [i32; 4];

/// Random coefficients, all from one seed.
pub struct Coefficients {
    limbs: Vec<Coefficient>,
    /// The sums of the first 0, 1, 2, … coefficients.
    running: Vec<Element>,
}

impl Coefficients {
    /// Expands the first `count` coefficients of `seed`.
    pub fn expand(seed: &Digest, count: usize) -> Self {
        let mut squeeze = Squeeze::new(Domain::Coefficients, seed);
        let mut limbs = Vec::with_capacity(count + 1);
        while limbs.len() < count {
            let [a, b, c, d, e, f, g, h] = squeeze
                .next()
                .map(|element| (element & ((1 << BITS) - 1)) as i32 - (1 << (BITS - 1)));
            limbs.push([a, b, c, d]);
            limbs.push([e, f, g, h]);
        }
        limbs.truncate(count);
        let mut sum = Element::ZERO;
        let mut running = Vec::with_capacity(count + 1);
        running.push(sum);
        for limbs in &limbs {
            sum = sum + compose(limbs.map(i128::from));
            running.push(sum);
        }
        Self { limbs, running }
    }

    /// The limbs of coefficients `first .. first + count`.
    pub fn range(&self, first: usize, count: usize) -> &[Coefficient] {
        &self.limbs[first..first + count]
    }

    /// Sum of coefficients `first .. first + count`.
    pub fn sum(&self, first: usize, count: usize) -> Element {
        self.running[first + count] - self.running[first]
    }
}

/// `Σ parts[k] · 2^(26k)`.
pub fn compose(parts: [i128; 4]) -> Element {
    Element::compose(parts, BITS)
}

/// How many terms |value| ≤ 2^31 times |limb| ≤ 2^25 fit an int64: 2^7 of them would reach 2^63.
const TERMS: usize = 120;
/// How many terms |value| ≤ 2^15 times limb < 2^36 are summed in an int64. More would fit.
const ELEMENT_TERMS: usize = 2048;

/// How many rows share the loads of the limbs.
const TOGETHER: usize = 3;

/// Returns the inner product of every row with the coefficients. Rows are as long as `coefficients`.
pub fn rows_with_coefficients<T: Copy + Into<i64>>(
    rows: Rows<'_, T>,
    coefficients: &[Coefficient],
) -> Vec<Element> {
    each_row(rows, coefficients, TERMS, compose)
}

/// Returns the inner product of every row with field elements. Rows are as long as `elements`.
pub fn rows_with_elements(rows: Rows<'_>, elements: &[Limbs]) -> Vec<Element> {
    each_row(rows, elements, ELEMENT_TERMS, |parts| {
        Element::compose(parts, LIMB_BITS)
    })
}

#[inline(always)]
fn each_row<T: Copy + Into<i64>, L: Limb, const K: usize>(
    rows: Rows<'_, T>,
    factors: &[[L; K]],
    terms: usize,
    compose: impl Fn([i128; K]) -> Element,
) -> Vec<Element> {
    let mut elements = Vec::with_capacity(rows.count());
    let mut row = 0;
    while let Some(rows) = rows.some::<TOGETHER>(row) {
        elements.extend(sums(rows, factors, terms).map(&compose));
        row += TOGETHER;
    }
    while let Some(rows) = rows.some::<1>(row) {
        elements.extend(sums(rows, factors, terms).map(&compose));
        row += 1;
    }
    elements
}

/// Per row and limb, `Σ value · limb`. `N` rows share the loads of the limbs; `terms` of them fit an int64.
#[inline(always)]
fn sums<T, L, const N: usize, const K: usize>(
    rows: [&[T]; N],
    factors: &[[L; K]],
    terms: usize,
) -> [[i128; K]; N]
where
    T: Copy + Into<i64>,
    L: Limb,
{
    let rows = rows.map(|row| &row[..factors.len()]);
    let mut totals = [[0i128; K]; N];
    let mut start = 0;
    while start < factors.len() {
        let end = factors.len().min(start + terms);
        let parts = short_sums(rows.map(|row| &row[start..end]), &factors[start..end]);
        for (totals, parts) in totals.iter_mut().zip(parts) {
            for (total, part) in totals.iter_mut().zip(parts) {
                *total += part as i128;
            }
        }
        start = end;
    }
    totals
}

/// [`sums`] of so few terms that they fit an int64. It takes four columns at a time, so that pointers move once for four.
#[inline(never)]
fn short_sums<T, L, const N: usize, const K: usize>(
    rows: [&[T]; N],
    factors: &[[L; K]],
) -> [[i64; K]; N]
where
    T: Copy + Into<i64>,
    L: Limb,
{
    let mut sums = [[0i64; K]; N];
    // All slices are cut to one length, so that the loops need no bounds checks.
    let (columns, quads) = (factors.len(), factors.len() / 4);
    let rows = rows.map(|row| &row[..columns]);
    let factors4 = &factors.as_chunks::<4>().0[..quads];
    let rows4 = rows.map(|row| &row.as_chunks::<4>().0[..quads]);
    for quad in 0..quads {
        for column in 0..4 {
            let values = rows4.map(|row| row[quad][column]);
            add_products(&mut sums, values, factors4[quad][column]);
        }
    }
    for column in 4 * quads..columns {
        add_products(&mut sums, rows.map(|row| row[column]), factors[column]);
    }
    sums
}

#[inline(always)]
fn add_products<T, L, const N: usize, const K: usize>(
    sums: &mut [[i64; K]; N],
    values: [T; N],
    factor: [L; K],
) where
    T: Into<i64>,
    L: Limb,
{
    let factor = factor.map(Limb::signed);
    for (sums, value) in sums.iter_mut().zip(values) {
        let value: i64 = value.into();
        for (sum, factor) in sums.iter_mut().zip(factor) {
            *sum = opaque(*sum + value * factor);
        }
    }
}

/// Returns `value`, and hides from the compiler what it is, so that the compiler keeps the order of additions. Otherwise it
/// adds up products before it adds them to their sum, and the guest has too few registers for that.
#[inline(always)]
fn opaque(value: i64) -> i64 {
    #[cfg(target_os = "zkvm")]
    // SAFETY: the assembly holds no instructions.
    unsafe {
        let mut value = value;
        core::arch::asm!("/* {0} */", inlateout(reg) value, options(pure, nomem, nostack, preserves_flags));
        return value;
    }
    #[cfg(not(target_os = "zkvm"))]
    value
}

/// A limb, which an int64 holds.
trait Limb: Copy {
    fn signed(self) -> i64;
}

impl Limb for i32 {
    #[inline(always)]
    fn signed(self) -> i64 {
        self as i64
    }
}

impl Limb for u64 {
    #[inline(always)]
    fn signed(self) -> i64 {
        self as i64 // below 2^36
    }
}

/// Returns `Σ coefficient_i · row_i`, one element per column.
pub fn combine_rows(rows: Rows<'_>, coefficients: &[Coefficient]) -> Vec<Element> {
    let mut combined = Vec::with_capacity(rows.columns());
    while combined.len() + TOGETHER <= rows.columns() {
        let parts = combine_columns::<TOGETHER>(rows, combined.len(), coefficients);
        combined.extend(parts.map(|parts| compose(parts.map(i128::from))));
    }
    while combined.len() < rows.columns() {
        let parts = combine_columns::<1>(rows, combined.len(), coefficients);
        combined.extend(parts.map(|parts| compose(parts.map(i128::from))));
    }
    combined
}

/// Columns `first .. first + N` of [`combine_rows`], per limb. |value| ≤ 2^15 and |limb| ≤ 2^25: 2^22 rows fit an int64.
#[inline(always)]
fn combine_columns<const N: usize>(
    rows: Rows<'_>,
    first: usize,
    coefficients: &[Coefficient],
) -> [[i64; 4]; N] {
    let mut sums = [[0i64; 4]; N];
    for (&values, &coefficient) in rows.some_columns(first).zip(coefficients) {
        add_products(&mut sums, values, coefficient);
    }
    sums
}
