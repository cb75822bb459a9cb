//! The prover's side of [`crate::sumcheck::verify_joined`].
//!
//! Each round makes one pass over the tables: it binds the last round's variable and computes what is stated next. Tables of the base field
//! stay there until the first variable is bound.

mod columns;
mod table;

use crate::field::{Extension, Goldilocks};
use crate::transcript::{Challenges, Prover};
use columns::{round, TableMonomials};
use rayon::prelude::*;
pub use table::MultilinearTable;
use table::Piece;

/// Terms of a piece, which one core computes at a time.
const PIECE: usize = 1 << 10;

/// A sum over all indices of `Σ coefficient · Π tables`.
pub struct Joined {
    tables: Vec<MultilinearTable>,
    monomials: TableMonomials,
    /// The challenge of the last round: the highest variable is not yet bound to it.
    pending: Option<Extension>,
    /// What the values of the next round polynomial at 0 and 1 add up to, once a round polynomial was computed.
    claim: Option<Extension>,
    /// What the sum is multiplied with.
    factor: Extension,
}

impl Joined {
    /// All tables have the same length, a power of two. A monomial names its tables by number.
    pub fn new(tables: Vec<Vec<Extension>>, monomials: Vec<(Extension, Vec<usize>)>) -> Self {
        Self::of_tables(
            tables.into_iter().map(MultilinearTable::from).collect(),
            monomials,
        )
    }

    /// Likewise, with tables that are known to be in the base field.
    pub fn of_tables(
        tables: Vec<MultilinearTable>,
        monomials: Vec<(Extension, Vec<usize>)>,
    ) -> Self {
        Self {
            tables,
            monomials: TableMonomials::new(monomials),
            pending: None,
            claim: None,
            factor: Extension::ONE,
        }
    }

    /// The sum, multiplied.
    pub fn times(mut self, factor: Extension) -> Self {
        self.factor *= factor;
        self
    }

    /// The length of the tables once all challenges are bound.
    fn len(&self) -> usize {
        let len = self.tables.first().map_or(0, MultilinearTable::len);
        len >> self.pending.is_some() as u32
    }

    /// The round polynomial's values at 0, 1, …, up to its own degree. The variable is the highest one.
    fn round(&mut self) -> Vec<Extension> {
        let half = self.len() / 2;
        let challenge = self.pending.take();
        if challenge.is_some() {
            self.tables.iter_mut().for_each(MultilinearTable::make_room);
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
        self.factor * self.monomials.value(|table| self.tables[table].first())
    }
}

/// Proves the sum of all `sums`, as [`crate::sumcheck::verify_joined`] states. Returns the challenges, those of the highest variables first, and
/// what the values there add up to.
pub fn prove(
    prover: &mut Prover,
    mut sums: Vec<Joined>,
    degree: usize,
) -> (Vec<Extension>, Extension) {
    let longest = sums.iter().map(Joined::len).max().unwrap_or(1);
    let variables = longest.max(1).ilog2() as usize;
    let mut point = Vec::with_capacity(variables);
    // The first polynomial of a sum that does not have all variables states what the sum is.
    let waiting = sums.iter_mut().map(|sum| match sum.len() {
        1 => vec![sum.monomials.value(|table| sum.tables[table].first())],
        length if length < longest => interpolate(&sum.round()),
        _ => vec![],
    });
    let mut waiting: Vec<Vec<Extension>> = waiting.collect();
    for variable in (0..variables).rev() {
        let mut coefficients = vec![Extension::ZERO; degree + 1];
        let mut own = vec![];
        for (sum, first) in sums.iter_mut().zip(&mut waiting) {
            let polynomial = match sum.len() == 2 << variable {
                true if !first.is_empty() => core::mem::take(first),
                true => interpolate(&sum.round()),
                false => {
                    // Twice the constant and all others once are the values at 0 and 1.
                    let total: Extension = match &first[..] {
                        [one] => *one,
                        all => all[0] + all.iter().copied().sum(),
                    };
                    vec![total, -total]
                }
            };
            for (total, &coefficient) in coefficients.iter_mut().zip(&polynomial) {
                *total += sum.factor * coefficient;
            }
            own.push(polynomial);
        }
        coefficients.remove(1); // The linear one follows from the claim
        prover.send_secret(&coefficients);
        let challenge = prover.challenge();
        for (sum, polynomial) in sums.iter_mut().zip(own) {
            if sum.len() == 2 << variable {
                let coefficients = polynomial.iter().rev();
                let value = coefficients.fold(Extension::ZERO, |sum, &c| sum * challenge + c);
                sum.claim = Some(value);
                sum.pending = Some(challenge);
            } else {
                sum.factor *= Extension::ONE - challenge;
            }
        }
        point.push(challenge);
    }
    (point, sums.into_iter().map(Joined::value).sum())
}

/// The coefficients of the polynomial with these values at 0, 1, 2, …
pub(super) fn interpolate(values: &[Extension]) -> Vec<Extension> {
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
    use crate::hash::SpongeDigest;
    use crate::multilinear::evaluate_extension;
    use crate::sumcheck::verify_joined;
    use crate::transcript::{Pads, Verifier};

    /// Elements that look random, of the base field if `small`.
    fn table(seed: &mut u64, bits: usize, small: bool) -> Vec<Extension> {
        let mut next = || {
            *seed = seed
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            Goldilocks::from_i64((*seed >> 1) as i64)
        };
        let element = |_| {
            if small {
                next().into()
            } else {
                Extension([next(), next()])
            }
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

    /// The sum over all indices of what `value` gives for the values of all tables there.
    fn total(sum: &Joined) -> Extension {
        let at = |index: usize| {
            let value = |table: &MultilinearTable| match table {
                MultilinearTable::Base(values) | MultilinearTable::Bound(values, _) => {
                    values[index].into()
                }
                MultilinearTable::Extension(values) => values[index],
            };
            sum.monomials.value(|table| value(&sum.tables[table]))
        };
        (0..sum.len()).map(at).sum()
    }

    /// A verifier accepts, and the values at its point add up to what it states. A sum that lacks variables counts once.
    #[test]
    fn the_verifier_comes_to_the_same_point() {
        let scale = Extension([9, 11].map(Goldilocks::from_u32));
        let statement = SpongeDigest([5, 6, 7, 8]);
        for bits in [2, 3, 9, 14] {
            let mut sums = sums(bits);
            sums[1].factor = scale;
            let claim = total(&sums[0]) + scale * total(&sums[1]) + total(&sums[2]);
            let pads = table(&mut 7, 10, false);
            let mut prover = Prover::new(&statement, Pads::new(pads));
            let (said, value) = prove(&mut prover, sums, 4);
            let secrets = prover.secrets().to_vec();
            let proof = prover.finish().unwrap();
            let mut verifier = Verifier::new(&statement, &proof);
            let (point, left) = verify_joined(&mut verifier, bits, 0, 4, claim.into()).unwrap();
            verifier.finish().unwrap();
            let expected = left.value(&secrets, &[]);
            assert_eq!(value, expected);
            let said: Vec<Extension> = said.into_iter().rev().collect();
            assert_eq!(point.own, said);
            let mut values = Extension::ZERO;
            for (number, mut sum) in self::sums(bits).into_iter().enumerate() {
                let variables = sum.len().ilog2() as usize;
                let tables = core::mem::take(&mut sum.tables).into_iter();
                let at = |table| {
                    let values: Vec<Extension> = match table {
                        MultilinearTable::Base(values) | MultilinearTable::Bound(values, _) => {
                            values.into_iter().map(Extension::from).collect()
                        }
                        MultilinearTable::Extension(values) => values,
                    };
                    evaluate_extension(&values, &said[..variables])
                };
                let tables: Vec<Extension> = tables.map(at).collect();
                let factor = if number == 1 { scale } else { Extension::ONE };
                let own = factor * sum.monomials.value(|table| tables[table]);
                values += own * point.absent(variables, true);
            }
            assert_eq!(values, expected);
        }
    }

    /// Prints how long a sum of monomials takes: `cargo test --release how_long -- --ignored --nocapture`.
    #[test]
    #[ignore = "it measures"]
    fn how_long() {
        for bits in [20, 22] {
            let sums = sums(bits);
            let pads = Pads::new(table(&mut 7, 10, false));
            let mut prover = Prover::new(&SpongeDigest([5, 6, 7, 8]), pads);
            let begin = std::time::Instant::now();
            prove(&mut prover, sums, 4);
            println!("2^{bits}: {:.2?}", begin.elapsed());
        }
    }
}
