//! Sums over the variables of instances, of which there are few: their polynomial is written out at all points of a grid, so that one pass over the
//! values of all instances does for all their rounds.

use super::joined::interpolate;
use crate::commitment::prove::columns::Column;
use crate::field::{Extension, Goldilocks};
use crate::transcript::{Challenges, Prover};
use core::ops::{Add, Mul, Range, Sub};
use rayon::prelude::*;

/// Indices that one core works on at a time.
const PIECE: usize = 1 << 8;
/// Pieces after which the pages of tables that are in files are dropped from memory.
const PIECES: usize = 1 << 8;

/// The values of a polynomial at {0, …, degree}^variables. The first coordinate changes fastest.
pub struct Grid {
    variables: usize,
    degree: usize,
    values: Vec<Extension>,
}

/// A value of a table.
pub trait Element:
    Copy + Default + Send + Sync + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self>
{
    /// The product with an integer of the statement.
    fn times(self, factor: i64) -> Self;
    /// The product with a weight.
    fn weighted(self, weight: Extension) -> Extension;
}

impl Element for Goldilocks {
    fn times(self, factor: i64) -> Self {
        self * Goldilocks::from_i64(factor)
    }

    fn weighted(self, weight: Extension) -> Extension {
        weight.scale(self)
    }
}

impl Element for Extension {
    fn times(self, factor: i64) -> Self {
        self.scale(Goldilocks::from_i64(factor))
    }

    fn weighted(self, weight: Extension) -> Extension {
        self * weight
    }
}

/// A table, of which a piece is read at a time.
pub trait Table<T>: Sync {
    /// How many values it has.
    fn size(&self) -> usize;
    /// The values at these places.
    fn piece(&self, places: Range<usize>) -> Vec<T>;
    /// Drops what is in files from memory, until somebody reads it again.
    fn release(&self);
}

impl Table<Extension> for [Extension] {
    fn size(&self) -> usize {
        self.len()
    }

    fn piece(&self, places: Range<usize>) -> Vec<Extension> {
        self[places].to_vec()
    }

    fn release(&self) {}
}

impl Table<Goldilocks> for Column {
    fn size(&self) -> usize {
        self.len()
    }

    fn piece(&self, places: Range<usize>) -> Vec<Goldilocks> {
        places
            .map(|place| Goldilocks::from_i64(self.get(place)))
            .collect()
    }

    fn release(&self) {
        Column::release(self);
    }
}

impl Grid {
    /// A polynomial that is zero.
    pub fn zero(variables: usize, degree: usize) -> Self {
        Self {
            variables,
            degree,
            values: vec![Extension::ZERO; (degree + 1).pow(variables as u32)],
        }
    }

    /// The multilinear polynomial with these values on {0, 1}^variables, and zero after the last one.
    pub fn multilinear(variables: usize, values: &[Extension]) -> Self {
        let mut values = values.to_vec();
        values.resize(1 << variables, Extension::ZERO);
        Self {
            variables,
            degree: 1,
            values,
        }
    }

    /// `Σ_x weights(x) · Σ coefficient · Π factors(x)`, where each factor has a table for each of 2^`variables` instances, and is multilinear in
    /// their variables. Weights repeat.
    pub fn of_tables<T: Element, R: Table<T> + ?Sized>(
        variables: usize,
        weights: &[Extension],
        factors: &[Vec<&R>],
        terms: &[(i64, Vec<usize>)],
    ) -> Self {
        let degree = terms.iter().map(|(_, own)| own.len()).max().unwrap_or(0);
        let mut grid = Self::zero(variables, degree);
        let points = grid.values.len();
        let size = factors.first().map_or(0, |tables| tables[0].size());
        let of_piece = |piece: usize| {
            let places = piece * PIECE..size.min((piece + 1) * PIECE);
            let factors = factors.iter().map(|tables| {
                let rows = tables.iter().map(|table| table.piece(places.clone()));
                extend(rows.collect(), variables, degree)
            });
            let factors: Vec<Vec<Vec<T>>> = factors.collect();
            let weights = || places.clone().map(|place| weights[place % weights.len()]);
            let value = |point: usize| {
                let mut sums = vec![T::default(); places.len()];
                for (coefficient, own) in terms {
                    let mut columns = own.iter().map(|&factor| &factors[factor][point]);
                    let Some(mut product) = columns.next().cloned() else {
                        continue;
                    };
                    for column in columns {
                        let pairs = product.iter_mut().zip(column);
                        pairs.for_each(|(product, &value)| *product = *product * value);
                    }
                    let pairs = sums.iter_mut().zip(product);
                    pairs.for_each(|(sum, value)| *sum = *sum + value.times(*coefficient));
                }
                let pairs = sums.iter().zip(weights());
                pairs.map(|(sum, weight)| sum.weighted(weight)).sum()
            };
            (0..points).map(value).collect::<Vec<Extension>>()
        };
        let add = |mut a: Vec<Extension>, b: Vec<Extension>| {
            for (a, b) in a.iter_mut().zip(b) {
                *a += b;
            }
            a
        };
        let pieces = size.div_ceil(PIECE);
        for first in (0..pieces).step_by(PIECES) {
            let own = (first..pieces.min(first + PIECES)).into_par_iter();
            let zero = || vec![Extension::ZERO; points];
            grid.values = add(grid.values, own.map(of_piece).reduce(zero, add));
            factors.iter().flatten().for_each(|table| table.release());
        }
        grid
    }

    /// Adds a polynomial times one that is multilinear and has the values `factor` on {0, 1}^variables. The product's degree is at most that of
    /// the sum.
    pub fn add_product(&mut self, other: &Self, factor: &[Extension]) {
        let rows = factor.iter().map(|&value| vec![value]).collect();
        let factor = extend(rows, self.variables, self.degree);
        let pairs = self.values.iter_mut().zip(other.raised(self.degree));
        for ((sum, value), factor) in pairs.zip(factor) {
            *sum += value * factor[0];
        }
    }

    /// Adds a sum that is over no instances. Its polynomial is `Π (1 − variable)`.
    pub fn add_constant(&mut self, sum: Extension) {
        let mut once = vec![Extension::ZERO; 1 << self.variables];
        once[0] = sum;
        let mut one = Self::zero(self.variables, 0);
        one.values[0] = Extension::ONE;
        self.add_product(&one, &once);
    }

    /// The values at {0, …, to}^variables.
    fn raised(&self, to: usize) -> Vec<Extension> {
        let mut values = self.values.clone();
        let mut below = 1;
        for _ in 0..self.variables {
            let block = below * (self.degree + 1);
            let mut raised = Vec::with_capacity(values.len() / (self.degree + 1) * (to + 1));
            for block in values.chunks_exact(block) {
                let polynomials = (0..below).map(|place| {
                    let column = block[place..].iter().step_by(below);
                    interpolate(&column.copied().collect::<Vec<_>>())
                });
                let polynomials: Vec<_> = polynomials.collect();
                for at in 0..=to as u32 {
                    let at = Goldilocks::from_u32(at).into();
                    raised.extend(polynomials.iter().map(|own| evaluate(own, at)));
                }
            }
            values = raised;
            below *= to + 1;
        }
        values
    }

    /// The sumcheck over all variables. Returns the challenges from the highest variable to the lowest, and the value that is left.
    pub fn prove(mut self, prover: &mut Prover) -> (Vec<Extension>, Extension) {
        let mut point = Vec::with_capacity(self.variables);
        while self.variables > 0 {
            let coefficients = interpolate(&self.round());
            let mut said = coefficients.clone();
            said.remove(1); // The linear one follows from the claim
            prover.send_secret(&said);
            let challenge = prover.challenge();
            self.bind(challenge);
            point.push(challenge);
        }
        (point, self.values[0])
    }

    /// The round polynomial of the highest variable, at 0, 1, …
    fn round(&self) -> Vec<Extension> {
        let side = self.degree + 1;
        let below = self.values.len() / side;
        let boolean = |mut place: usize| {
            let mut coordinates = (1..self.variables).map(|_| {
                let coordinate = place % side;
                place /= side;
                coordinate
            });
            coordinates.all(|coordinate| coordinate < 2)
        };
        let sums = self.values.chunks_exact(below).map(|row| {
            let own = row.iter().enumerate();
            own.filter(|(place, _)| boolean(*place))
                .map(|(_, &v)| v)
                .sum()
        });
        sums.collect()
    }

    /// Binds the highest variable.
    fn bind(&mut self, challenge: Extension) {
        let below = self.values.len() / (self.degree + 1);
        let value = |place: usize| {
            let column = self.values[place..].iter().step_by(below);
            let column: Vec<Extension> = column.copied().collect();
            evaluate(&interpolate(&column), challenge)
        };
        self.values = (0..below).map(value).collect();
        self.variables -= 1;
    }
}

/// The value of a polynomial with these coefficients.
fn evaluate(coefficients: &[Extension], at: Extension) -> Extension {
    let coefficients = coefficients.iter().rev();
    coefficients.fold(Extension::ZERO, |sum, &c| sum * at + c)
}

/// The values at an integer of polynomials of degree 1.
fn between<T: Element>(zero: &[T], one: &[T], at: usize) -> Vec<T> {
    match at {
        0 => zero.to_vec(),
        1 => one.to_vec(),
        _ => {
            let pairs = zero.iter().zip(one);
            let value = |(&zero, &one): (&T, &T)| zero + (one - zero).times(at as i64);
            pairs.map(value).collect()
        }
    }
}

/// Rows at {0, 1}^variables, at {0, …, degree}^variables.
fn extend<T: Element>(mut rows: Vec<Vec<T>>, variables: usize, degree: usize) -> Vec<Vec<T>> {
    // One variable after the other, from the lowest: below it the grid, above it {0, 1}.
    let mut below = 1;
    for _ in 0..variables {
        let mut extended = Vec::with_capacity(rows.len() / 2 * (degree + 1));
        for pair in rows.chunks_exact(2 * below) {
            let (zero, one) = pair.split_at(below);
            for at in 0..=degree {
                let rows = zero.iter().zip(one);
                extended.extend(rows.map(|(zero, one)| between(zero, one, at)));
            }
        }
        rows = extended;
        below *= degree + 1;
    }
    rows
}
