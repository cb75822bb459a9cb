//! Multilinear polynomials. One in n variables is given by its values on {0, 1}^n: a list of 2^n, where variable 0 is the lowest bit of the
//! index. A point lists the variables from 0 on.

#[cfg(feature = "prove")]
use crate::field::lazy::LazyFactor;
use crate::field::{Extension, Goldilocks};
use alloc::vec::Vec;
#[cfg(feature = "prove")]
use rayon::prelude::*;

/// `eq(point, b)` for all b in {0, 1}^n: what the values are multiplied with to get the value at `point`.
pub fn eq_table(point: &[Extension]) -> Vec<Extension> {
    let mut table = Vec::with_capacity(1 << point.len());
    table.push(Extension::ONE);
    for &coordinate in point {
        // The new variable becomes the highest bit.
        for index in 0..table.len() {
            let one = table[index] * coordinate;
            table.push(one);
            table[index] -= one;
        }
    }
    table
}

/// All products of a weight in `low` and one in `high`; the index in `low` changes fastest.
pub fn outer(low: &[Extension], high: &[Extension]) -> Vec<Extension> {
    let rows = high.iter();
    rows.flat_map(|&b| low.iter().map(move |&a| a * b))
        .collect()
}

/// `eq(a, b) = Π (a·b + (1 − a)(1 − b))`.
pub fn eq(a: &[Extension], b: &[Extension]) -> Extension {
    let factors = a.iter().zip(b).map(|(&a, &b)| {
        let both = a * b;
        Extension::ONE - a - b + both + both
    });
    factors.fold(Extension::ONE, |product, factor| product * factor)
}

/// `eq` with the bits of `index` in place of a point.
pub fn eq_bits(index: usize, point: &[Extension]) -> Extension {
    let coordinates = point.iter().enumerate();
    coordinates.fold(Extension::ONE, |product, (bit, &coordinate)| {
        let one = product * coordinate;
        match index >> bit & 1 {
            1 => one,
            _ => product - one,
        }
    })
}

/// [`eq_bits`] of one index after the other. Indices that are near each other share their higher bits, so that most of a product is known
/// from the index before.
pub struct EqBits<'a> {
    point: &'a [Extension],
    index: usize,
    /// Entry `i` is the product over the highest `i` bits of the index.
    products: Vec<Extension>,
}

impl<'a> EqBits<'a> {
    /// For indices with as many bits as `point` has coordinates.
    pub fn new(point: &'a [Extension]) -> Self {
        Self {
            point,
            index: 0,
            products: alloc::vec![Extension::ONE],
        }
    }

    /// `eq` of the bits of `index` from bit `low` on.
    pub fn above(&mut self, index: usize, low: usize) -> Extension {
        let bits = self.point.len();
        let differing = (usize::BITS - (index ^ self.index).leading_zeros()) as usize;
        let shared = bits.saturating_sub(differing);
        self.products.truncate(shared + 1);
        self.index = index;
        for bit in (low..bits + 1 - self.products.len()).rev() {
            let product = self.products[bits - 1 - bit];
            let one = product * self.point[bit];
            self.products.push(match index >> bit & 1 {
                1 => one,
                _ => product - one,
            });
        }
        self.products[bits - low]
    }
}

/// The value at `point` of the polynomial with these values.
pub fn evaluate(values: &[Goldilocks], point: &[Extension]) -> Extension {
    // A table for the lower half of the variables, and one for the upper half.
    let (low, high) = point.split_at(point.len() / 2);
    let (low_table, high_table) = (eq_table(low), eq_table(high));
    let rows = values.chunks_exact(low_table.len()).zip(&high_table);
    rows.map(|(row, &weight)| weight * Extension::dot(&low_table, row))
        .sum()
}

/// The value at `point` of the polynomial with these values.
#[cfg(feature = "prove")]
pub fn evaluate_extension(values: &[Extension], point: &[Extension]) -> Extension {
    let weights = eq_table(point);
    weights.iter().zip(values).map(|(&w, &v)| w * v).sum()
}

/// Binds variable 0 of the polynomial with these values to `challenge`.
#[cfg(feature = "prove")]
pub fn bind(values: &mut Vec<Extension>, challenge: Extension) {
    let factor = LazyFactor::new(challenge);
    let pairs = values.as_chunks::<2>().0.par_iter().with_min_len(1 << 12);
    *values = pairs
        .map(|&[zero, one]| factor.between(zero, one))
        .collect();
}
