//! The prover's side of [`crate::sumcheck::verify_joined`].
//!
//! Each round makes one pass over the tables: it binds the last round's variable and computes what is said next. Tables of the base field
//! stay there until the first variable is bound.

mod columns;
mod table;

use crate::field::{Extension, Goldilocks};
use crate::transcript::{Challenges, Prover};
use columns::{round, Monomials};
use rayon::prelude::*;
use table::Piece;
pub use table::Table;

/// Terms of a piece, which one core computes at a time.
const PIECE: usize = 1 << 10;

/// A sum over all indices of `Σ coefficient · Π tables`.
pub struct Joined {
    tables: Vec<Table>,
    monomials: Monomials,
    /// The challenge of the last round: the highest variable is not yet bound to it.
    pending: Option<Extension>,
    /// What the values of the next round polynomial at 0 and 1 add up to, once a round polynomial was computed.
    claim: Option<Extension>,
}

impl Joined {
    /// All tables have the same length, a power of two. A monomial names its tables by number.
    pub fn new(tables: Vec<Vec<Extension>>, monomials: Vec<(Extension, Vec<usize>)>) -> Self {
        Self::of_tables(tables.into_iter().map(Table::from).collect(), monomials)
    }

    /// Likewise, with tables that are known to be in the base field.
    pub fn of_tables(tables: Vec<Table>, monomials: Vec<(Extension, Vec<usize>)>) -> Self {
        Self {
            tables,
            monomials: Monomials::new(monomials),
            pending: None,
            claim: None,
        }
    }

    /// The length of the tables once all challenges are bound.
    fn len(&self) -> usize {
        let len = self.tables.first().map_or(0, Table::len);
        len >> self.pending.is_some() as u32
    }

    /// The round polynomial's values at 0, 1, …, up to its own degree. The variable is the highest one.
    fn round(&mut self) -> Vec<Extension> {
        let half = self.len() / 2;
        let challenge = self.pending.take();
        if challenge.is_some() {
            self.tables.iter_mut().for_each(Table::make_room);
        }
        let mut tables: Vec<_> = self
            .tables
            .iter_mut()
            .map(|table| table.pieces(half, challenge, PIECE))
            .collect();
        let pieces = (0..half.div_ceil(PIECE)).map(|_| -> Vec<Piece> {
            let pieces = tables.iter_mut().filter_map(Iterator::next);
            pieces.collect()
        });
        let pieces: Vec<Vec<Piece>> = pieces.collect();
        drop(tables);
        let claim = self.claim;
        let (monomials, degree) = (&self.monomials, self.monomials.degree());
        let pieces = pieces.into_par_iter();
        let sums = pieces.map(|pieces| round(pieces, monomials, claim.is_some()));
        let add = |mut a: Vec<Extension>, b: Vec<Extension>| {
            for (a, b) in a.iter_mut().zip(b) {
                *a += b;
            }
            a
        };
        let mut values = sums.reduce(|| vec![Extension::ZERO; degree + 1], add);
        if let Some(claim) = claim {
            values[1] = claim - values[0];
        }
        self.tables
            .iter_mut()
            .for_each(|table| table.shrink(2 * half));
        values
    }

    /// The sum that is left when no variable is.
    fn value(mut self) -> Extension {
        if let Some(challenge) = self.pending {
            self.tables
                .iter_mut()
                .for_each(|table| table.bind_last(challenge));
        }
        self.monomials.value(|table| self.tables[table].first())
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
        let mut coefficients = vec![Extension::ZERO; degree + 1];
        let mut own = vec![];
        for sum in sums.iter_mut().filter(|sum| sum.len() == 2 << variable) {
            let polynomial = interpolate(&sum.round());
            for (total, &coefficient) in coefficients.iter_mut().zip(&polynomial) {
                *total += coefficient;
            }
            own.push((sum, polynomial));
        }
        coefficients.remove(1); // The linear one follows from the claim
        prover.send_extension(&coefficients);
        let challenge = prover.challenge();
        for (sum, polynomial) in own {
            let coefficients = polynomial.iter().rev();
            let value = coefficients.fold(Extension::ZERO, |sum, &c| sum * challenge + c);
            sum.claim = Some(value);
            sum.pending = Some(challenge);
        }
        point[variable] = challenge;
    }
    (point, sums.into_iter().map(Joined::value).sum())
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
