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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hash::{leaf, Digest};

    /// Elements that look random, of the base field if `small`.
    fn table(seed: &mut u64, bits: usize, small: bool) -> Vec<Extension> {
        let mut next = || {
            *seed = seed
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            Goldilocks::from_i64((*seed >> 1) as i64)
        };
        let element = |_| match small {
            true => next().into(),
            false => Extension([next(), next()]),
        };
        (0..1 << bits).map(element).collect()
    }

    /// Weights times monomials of up to four tables, and a product.
    fn sums(bits: usize) -> Vec<Joined> {
        let mut seed = bits as u64;
        let mut of = |bits, small: &[bool]| -> Vec<Vec<Extension>> {
            let tables = small.iter().map(|&small| table(&mut seed, bits, small));
            tables.collect()
        };
        let first = of(bits, &[false, true, true, true, false]);
        let second = of(bits - 2, &[false, true]);
        let third = of(0, &[false, true]);
        let scalar = |value| Goldilocks::from_i64(value).into();
        vec![
            Joined::new(
                first,
                vec![
                    (scalar(1), vec![0, 1, 2]),
                    (scalar(-3), vec![0, 3]),
                    (scalar(7), vec![0, 4, 1, 1]),
                    (scalar(2), vec![0]),
                ],
            ),
            Joined::new(
                second,
                vec![(Extension([3, 4].map(Goldilocks::from_u32)), vec![0, 1])],
            ),
            Joined::new(third, vec![(scalar(5), vec![0, 1])]),
        ]
    }

    fn digest(bits: usize, degree: usize) -> [u64; 4] {
        let mut prover = Prover::new(&Digest([5, 6, 7, 8]));
        let (point, value) = prove(&mut prover, sums(bits), degree);
        assert_eq!(point.len(), bits);
        let last = prover.challenge();
        prover.send_extension(&[value, last]);
        leaf(Goldilocks::of_words(&prover.finish()).unwrap()).0
    }

    const JOINED: [[u64; 4]; 4] = [
        [
            1648571154988022337,
            2512154379050480092,
            3053601966711917695,
            3232230806215858385,
        ],
        [
            3410508607532779984,
            8833178129893348119,
            90785061518577106,
            7148836781396442883,
        ],
        [
            6013473263117273068,
            7007584536137716071,
            4687585276038188936,
            3091134479252176314,
        ],
        [
            4123125290798137010,
            3035780781268952233,
            6491065309929897762,
            8765946513968700135,
        ],
    ];

    /// Proofs stay what they are: the digests are of proofs by the first, plain prover.
    #[test]
    fn proofs_are_unchanged() {
        let digests = [2, 3, 9, 14].map(|bits| digest(bits, 4));
        assert_eq!(digests, JOINED);
    }

    /// Prints how long a sum of monomials takes: `cargo test --release how_long -- --ignored --nocapture`.
    #[test]
    #[ignore = "it measures"]
    fn how_long() {
        for bits in [20, 22] {
            let sums = sums(bits);
            let mut prover = Prover::new(&Digest([5, 6, 7, 8]));
            let begin = std::time::Instant::now();
            prove(&mut prover, sums, 4);
            println!("2^{bits}: {:.2?}", begin.elapsed());
        }
    }
}
