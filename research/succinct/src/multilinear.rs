//! Multilinear extensions. The values of a polynomial in n variables are a list of 2^n; variable 0 is the lowest bit of
//! the index. Points list the variables from 0 on.

use crate::field::{E, F};

/// `eq(point, b)` for all b.
pub fn eq_table(point: &[E]) -> Vec<E> {
    let mut table = vec![E::ONE];
    table.reserve(1 << point.len());
    for &coordinate in point {
        // The new variable becomes the highest bit.
        let half = table.len();
        for index in 0..half {
            let one = table[index] * coordinate;
            table.push(one);
            table[index] = table[index] - one;
        }
    }
    table
}

/// `Π (a·b + (1 − a)(1 − b))`.
pub fn eq(a: &[E], b: &[E]) -> E {
    a.iter().zip(b).fold(E::ONE, |product, (&a, &b)| {
        let both = a * b;
        product * (E::ONE - a - b + both + both)
    })
}

/// `eq` with the bits of `index` in place of a point.
pub fn eq_bits(index: usize, point: &[E]) -> E {
    point.iter().enumerate().fold(E::ONE, |product, (bit, &coordinate)| {
        let one = product * coordinate;
        if index >> bit & 1 == 1 {
            one
        } else {
            product - one
        }
    })
}

/// The value at `point` of the polynomial with these values.
pub fn evaluate(values: &[F], point: &[E]) -> E {
    // A table for the lower half of the variables, one value of it per index of the upper half.
    let low = point.len() / 2;
    let (low_table, high_table) = (eq_table(&point[..low]), eq_table(&point[low..]));
    values
        .chunks_exact(1 << low)
        .zip(&high_table)
        .fold(E::ZERO, |sum, (row, &weight)| sum + weight * E::dot_base(&low_table, row))
}

/// Binds variable 0 to `challenge`.
pub fn bind(values: &mut Vec<E>, challenge: E) {
    let half = values.len() / 2;
    for index in 0..half {
        let (zero, one) = (values[2 * index], values[2 * index + 1]);
        values[index] = zero + challenge * (one - zero);
    }
    values.truncate(half);
}
