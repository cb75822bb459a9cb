//! The round polynomial over one piece, computed table by table: a loop over many values of one table is what a processor is good at.

use super::table::Piece;
use crate::field::lazy::{LazyFactor, LazySum};
use crate::field::{Extension, Goldilocks};

/// `Σ coefficient · Π tables`.
pub struct TableMonomials {
    /// A table that is a factor of all monomials.
    common: Option<usize>,
    /// The coefficients, and the tables without the common one.
    terms: Vec<(Extension, Vec<usize>)>,
}

impl TableMonomials {
    /// A monomial names its tables by number.
    pub fn new(mut terms: Vec<(Extension, Vec<usize>)>) -> Self {
        let first = terms.first().map_or(&[][..], |(_, tables)| tables);
        let in_all = |table: &&usize| terms.iter().all(|(_, tables)| tables.contains(table));
        let common = first.iter().find(in_all).copied();
        for (_, tables) in &mut terms {
            if let Some(place) = tables.iter().position(|&table| Some(table) == common) {
                tables.remove(place);
            }
        }
        Self { common, terms }
    }

    /// The degree in each variable, but at least 1.
    pub fn degree(&self) -> usize {
        let most = self.terms.iter().map(|(_, tables)| tables.len()).max();
        (most.unwrap_or_default() + self.common.is_some() as usize).max(1)
    }

    /// The value for these values of the tables.
    pub fn value(&self, table: impl Fn(usize) -> Extension) -> Extension {
        let term = |(coefficient, tables): &(Extension, Vec<usize>)| {
            let factors = tables.iter().map(|&number| table(number));
            factors.fold(*coefficient, |product, value| product * value)
        };
        let sum: Extension = self.terms.iter().map(term).sum();
        self.common.map_or(sum, |common| sum * table(common))
    }
}

/// Values of one table, or of a product.
#[derive(Clone)]
enum JoinedColumn {
    Base(Vec<Goldilocks>),
    Extension(Vec<Extension>),
}

/// The values of the round polynomial over a piece at 0, 1, …, up to its degree, or 0 in place of that at 1.
pub fn round(pieces: Vec<Piece>, monomials: &TableMonomials, without_one: bool) -> Vec<Extension> {
    // The values of each table at one point, and what to add for the next point.
    let mut tables: Vec<[JoinedColumn; 2]> = pieces.into_iter().map(columns).collect();
    let count = tables.first().map_or(0, |[value, _]| value.len());
    let value = |point: usize| {
        if point > 0 {
            tables.iter_mut().for_each(|[value, step]| value.add(step));
        }
        if point == 1 && without_one {
            Extension::ZERO
        } else {
            sum(&tables, monomials, count)
        }
    };
    (0..=monomials.degree()).map(value).collect()
}

/// The values where the highest variable is 0, and the difference to those where it is 1.
fn columns(piece: Piece) -> [JoinedColumn; 2] {
    fn difference<T: Copy + core::ops::Sub<Output = T>>(zero: &[T], one: &[T]) -> Vec<T> {
        zero.iter()
            .zip(one)
            .map(|(&zero, &one)| one - zero)
            .collect()
    }
    match piece {
        Piece::Base([zero, one]) => [zero.to_vec(), difference(zero, one)].map(JoinedColumn::Base),
        Piece::Extension([zero, one]) => {
            [zero.to_vec(), difference(zero, one)].map(JoinedColumn::Extension)
        }
        Piece::BoundBase(factor, [a, b, c, d], [zero, one]) => {
            for (target, from, to) in [(&mut *zero, a, c), (&mut *one, b, d)] {
                for ((target, &from), &to) in target.iter_mut().zip(from).zip(to) {
                    *target = factor.between_base(from, to);
                }
            }
            [zero.to_vec(), difference(zero, one)].map(JoinedColumn::Extension)
        }
        Piece::BoundExtension(factor, [zero, one], [c, d]) => {
            for (target, to) in [(&mut *zero, c), (&mut *one, d)] {
                for (target, &to) in target.iter_mut().zip(to) {
                    *target = factor.between(*target, to);
                }
            }
            [zero.to_vec(), difference(zero, one)].map(JoinedColumn::Extension)
        }
    }
}

/// The sum of all monomials over all indices, at one point.
fn sum(tables: &[[JoinedColumn; 2]], monomials: &TableMonomials, count: usize) -> Extension {
    let column = |&table: &usize| &tables[table][0];
    let ones = JoinedColumn::Base(vec![Goldilocks::ONE; count]);
    let common = monomials.common.as_ref().map_or(&ones, column);
    if let [(coefficient, factors)] = &monomials.terms[..] {
        // The coefficient of a single monomial can wait.
        return *coefficient
            * match &factors[..] {
                [] => common.total(&ones),
                [factor] => common.total(column(factor)),
                [first, rest @ ..] => {
                    let product = JoinedColumn::product(column(first), rest.iter().map(column));
                    common.total(&product)
                }
            };
    }
    let mut inner = JoinedColumn::Base(vec![Goldilocks::ZERO; count]);
    for (coefficient, factors) in &monomials.terms {
        let (first, rest) = match factors.split_first() {
            Some((first, rest)) => (column(first), rest),
            None => (&ones, &[][..]),
        };
        let mut product = JoinedColumn::product(first, rest.iter().map(column));
        product.scale(*coefficient);
        inner.add(&product);
    }
    common.total(&inner)
}

impl JoinedColumn {
    fn len(&self) -> usize {
        match self {
            Self::Base(values) => values.len(),
            Self::Extension(values) => values.len(),
        }
    }

    fn add(&mut self, other: &Self) {
        match (&mut *self, other) {
            (Self::Base(values), Self::Base(others)) => {
                for (value, &other) in values.iter_mut().zip(others) {
                    *value += other;
                }
            }
            (Self::Extension(values), Self::Extension(others)) => {
                for (value, &other) in values.iter_mut().zip(others) {
                    *value += other;
                }
            }
            (Self::Extension(values), Self::Base(others)) => {
                for (value, &other) in values.iter_mut().zip(others) {
                    value.0[0] += other;
                }
            }
            (Self::Base(values), Self::Extension(_)) => {
                let mut sum = other.clone();
                sum.add(&Self::Base(core::mem::take(values)));
                *self = sum;
            }
        }
    }

    fn scale(&mut self, factor: Extension) {
        match self {
            _ if factor == Extension::ONE => {}
            Self::Base(values) if factor.0[1] == Goldilocks::ZERO => {
                values.iter_mut().for_each(|value| *value *= factor.0[0]);
            }
            Self::Base(values) => {
                let scaled = values.iter().map(|&value| factor.scale(value));
                *self = Self::Extension(scaled.collect());
            }
            Self::Extension(values) => {
                let factor = LazyFactor::new(factor);
                for value in values {
                    *value = factor.times_plus(*value, Extension::ZERO);
                }
            }
        }
    }

    fn times(&self, other: &Self) -> Self {
        match (self, other) {
            (Self::Base(a), Self::Base(b)) => {
                Self::Base(a.iter().zip(b).map(|(&a, &b)| a * b).collect())
            }
            (Self::Extension(a), Self::Base(b)) | (Self::Base(b), Self::Extension(a)) => {
                Self::Extension(a.iter().zip(b).map(|(a, &b)| a.scale(b)).collect())
            }
            (Self::Extension(a), Self::Extension(b)) => {
                Self::Extension(a.iter().zip(b).map(|(&a, &b)| a * b).collect())
            }
        }
    }

    fn product<'a>(first: &Self, rest: impl Iterator<Item = &'a Self>) -> Self {
        let mut product = None;
        for factor in rest {
            product = Some(product.as_ref().unwrap_or(first).times(factor));
        }
        product.unwrap_or_else(|| first.clone())
    }

    /// The sum of the products of two columns.
    fn total(&self, other: &Self) -> Extension {
        let mut sum = LazySum::default();
        match (self, other) {
            (Self::Extension(a), Self::Extension(b)) => {
                a.iter().zip(b).for_each(|(&a, &b)| sum.add(a, b));
            }
            (Self::Extension(a), Self::Base(b)) | (Self::Base(b), Self::Extension(a)) => {
                a.iter().zip(b).for_each(|(&a, &b)| sum.add_scaled(a, b));
            }
            (Self::Base(a), Self::Base(b)) => {
                let products = a.iter().zip(b);
                products.for_each(|(&a, &b)| sum.add_scaled(a.into(), b));
            }
        }
        sum.reduce()
    }
}
