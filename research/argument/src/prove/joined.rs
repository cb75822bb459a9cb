//! The prover's side of [`crate::sumcheck::verify_joined`].

use crate::field::{Extension, Goldilocks};
use crate::transcript::{Challenges, Prover};
use rayon::prelude::*;

/// Most coefficients of a round polynomial.
const COEFFICIENTS: usize = 5;
/// Terms below which a loop is not worth sharing among cores.
const SHARED: usize = 1 << 10;

/// A sum over all indices of `Σ coefficient · Π tables`.
pub struct Joined {
    tables: Vec<Vec<Extension>>,
    monomials: Vec<(Extension, Vec<usize>)>,
}

impl Joined {
    /// All tables have the same length, a power of two. A monomial names its tables by number.
    pub fn new(tables: Vec<Vec<Extension>>, monomials: Vec<(Extension, Vec<usize>)>) -> Self {
        Self { tables, monomials }
    }

    fn len(&self) -> usize {
        self.tables.first().map_or(0, Vec::len)
    }

    /// The round polynomial's values at 0, 1, …, `degree`. The variable is the highest one.
    fn round(&self, degree: usize) -> [Extension; COEFFICIENTS] {
        let half = self.len() / 2;
        let term = |index: usize| {
            let mut values = [Extension::ZERO; COEFFICIENTS];
            for (coefficient, tables) in &self.monomials {
                let mut products = [*coefficient; COEFFICIENTS];
                for &table in tables {
                    let table = &self.tables[table];
                    let (mut value, step) = (table[index], table[index + half] - table[index]);
                    for product in &mut products[..=degree] {
                        *product *= value;
                        value += step;
                    }
                }
                for (value, product) in values.iter_mut().zip(products) {
                    *value += product;
                }
            }
            values
        };
        let add = |mut a: [Extension; COEFFICIENTS], b: [Extension; COEFFICIENTS]| {
            for (a, b) in a.iter_mut().zip(b) {
                *a += b;
            }
            a
        };
        let terms = (0..half).into_par_iter().with_min_len(SHARED).map(term);
        terms.reduce(|| [Extension::ZERO; COEFFICIENTS], add)
    }

    /// Binds the highest variable.
    fn bind(&mut self, challenge: Extension) {
        let half = self.len() / 2;
        for table in &mut self.tables {
            let (low, high) = table.split_at_mut(half);
            let pairs = low.par_iter_mut().zip(high).with_min_len(SHARED);
            pairs.for_each(|(zero, one)| *zero += challenge * (*one - *zero));
            table.truncate(half);
        }
    }

    /// The sum that is left when no variable is.
    fn value(&self) -> Extension {
        let product = |(coefficient, tables): &(Extension, Vec<usize>)| {
            let factors = tables.iter().map(|&table| self.tables[table][0]);
            factors.fold(*coefficient, |product, value| product * value)
        };
        self.monomials.iter().map(product).sum()
    }
}

/// Proves the sum of all `sums`. Returns the point, and what their values there add up to.
pub fn prove(
    prover: &mut Prover,
    mut sums: Vec<Joined>,
    degree: usize,
) -> (Vec<Extension>, Extension) {
    let longest = sums.iter().map(Joined::len).max().unwrap_or(1);
    let variables = longest.max(1).ilog2() as usize;
    let mut point = vec![Extension::ZERO; variables];
    for variable in (0..variables).rev() {
        let mut values = [Extension::ZERO; COEFFICIENTS];
        let active = |sum: &&mut Joined| sum.len() == 2 << variable;
        for sum in sums.iter_mut().filter(active) {
            for (total, value) in values.iter_mut().zip(sum.round(degree)) {
                *total += value;
            }
        }
        let mut coefficients = interpolate(&values[..=degree]);
        coefficients.remove(1); // The linear one follows from the claim
        prover.send_extension(&coefficients);
        let challenge = prover.challenge();
        for sum in sums.iter_mut().filter(active) {
            sum.bind(challenge);
        }
        point[variable] = challenge;
    }
    (point, sums.iter().map(Joined::value).sum())
}

/// The coefficients of the polynomial with these values at 0, 1, 2, …
fn interpolate(values: &[Extension]) -> Vec<Extension> {
    // Newton's divided differences, and then the product with (x − k) from the last k down.
    let mut differences = values.to_vec();
    for order in 1..values.len() {
        let inverse = Goldilocks::from_u32(order as u32).inverse();
        for index in (order..values.len()).rev() {
            differences[index] = (differences[index] - differences[index - 1]).scale(inverse);
        }
    }
    let mut coefficients: Vec<Extension> = vec![];
    for (k, &difference) in differences.iter().enumerate().rev() {
        let root = Goldilocks::from_u32(k as u32);
        let mut next = vec![Extension::ZERO; coefficients.len() + 1];
        for (degree, &coefficient) in coefficients.iter().enumerate() {
            next[degree + 1] += coefficient;
            next[degree] -= coefficient.scale(root);
        }
        next[0] += difference;
        coefficients = next;
    }
    coefficients
}
