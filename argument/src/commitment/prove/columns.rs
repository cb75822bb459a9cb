//! The values of a segment, as the prover keeps them: each column in as few bytes a value as its largest integer needs, in memory or in a file.

use super::stored::StoredValues;
use crate::field::goldilocks::{Products, P};
use crate::field::{Extension, Goldilocks};
use crate::multilinear::eq_table;
use p3_field::PrimeCharacteristicRing;
use p3_goldilocks::Goldilocks as Theirs;
use rayon::prelude::*;
use std::io;
use std::path::Path;

/// The values of one polynomial.
#[derive(Debug)]
pub enum Column {
    /// Most values are int16.
    Narrow(StoredValues<i16>),
    /// Integers of 32 bits.
    Medium(StoredValues<i32>),
    /// Anything else.
    Wide(StoredValues<i64>),
}

/// Columns that are cut from rows at once, so that each line of a cache is read once.
const LINE: usize = 8;
/// Rows that are put together at once, so that they stay in a cache meanwhile.
const ROWS: usize = 32;

impl From<Vec<Goldilocks>> for Column {
    fn from(values: Vec<Goldilocks>) -> Self {
        let integers: Vec<i64> = values.iter().map(|value| integer(*value)).collect();
        Self::of_integers(&integers)
    }
}

/// The integer of least magnitude that an element stands for.
fn integer(element: Goldilocks) -> i64 {
    let value = element.value();
    if value > P / 2 {
        value.wrapping_sub(P) as i64
    } else {
        value as i64
    }
}

impl Column {
    /// Columns of `height` integers each, which lie one after the other: the first `count`.
    pub fn cut(values: &[i64], height: usize, count: usize) -> Vec<Self> {
        let columns = values.par_chunks_exact(height).take(count);
        columns.map(Self::of_integers).collect()
    }

    /// Integers of least magnitude that stand for elements.
    pub fn of_integers(values: &[i64]) -> Self {
        // The bits that differ from the sign, in any of the values.
        let bits = values
            .iter()
            .fold(0, |bits, value| bits | (value ^ value >> 63));
        let signed = values.iter();
        match bits {
            _ if bits <= i16::MAX as i64 => {
                Self::Narrow(signed.map(|&value| value as i16).collect::<Vec<_>>().into())
            }
            _ if bits <= i32::MAX as i64 => {
                Self::Medium(signed.map(|&value| value as i32).collect::<Vec<_>>().into())
            }
            _ => Self::Wide(values.to_vec().into()),
        }
    }

    /// Moves the values to a file in a folder.
    pub fn into_file(self, folder: &Path) -> io::Result<Self> {
        Ok(match self {
            Self::Narrow(values) => Self::Narrow(values.into_file(folder)?),
            Self::Medium(values) => Self::Medium(values.into_file(folder)?),
            Self::Wide(values) => Self::Wide(values.into_file(folder)?),
        })
    }

    /// Drops values that are in a file from the process's memory, until somebody uses them again.
    pub fn release(&self) {
        match self {
            Self::Narrow(values) => values.release(),
            Self::Medium(values) => values.release(),
            Self::Wide(values) => values.release(),
        }
    }

    /// The value with this number, as an integer.
    #[inline(always)]
    pub fn get(&self, index: usize) -> i64 {
        match self {
            Self::Narrow(values) => values[index].into(),
            Self::Medium(values) => values[index].into(),
            Self::Wide(values) => values[index],
        }
    }

    /// How many values it has.
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Narrow(values) => values.len(),
            Self::Medium(values) => values.len(),
            Self::Wide(values) => values.len(),
        }
    }

    /// In how many pieces of 16 bits its values are cut.
    pub(super) fn pieces(&self) -> u32 {
        match self {
            Self::Narrow(_) => 1,
            Self::Medium(_) => 2,
            Self::Wide(_) => 4,
        }
    }

    /// A piece of each value from number `first` on: how often 2^(16·piece) is in it. Pieces are signed.
    pub(super) fn piece(&self, piece: u32, first: usize, pieces: &mut [f64]) {
        fn cut<T: Copy + Into<i64>>(values: &[T], piece: u32, last: u32, pieces: &mut [f64]) {
            for (target, &value) in pieces.iter_mut().zip(values) {
                let mut rest: i64 = value.into();
                for _ in 0..piece {
                    rest = (rest - i64::from(rest as i16)) >> i16::BITS;
                }
                let own = if piece < last {
                    i64::from(rest as i16)
                } else {
                    rest
                };
                *target = own as f64;
            }
        }
        let range = first..first + pieces.len();
        match self {
            Self::Narrow(values) => cut(&values[range], piece, 0, pieces),
            Self::Medium(values) => cut(&values[range], piece, 1, pieces),
            Self::Wide(values) => cut(&values[range], piece, 3, pieces),
        }
    }

    /// Calls `with` for each of `count` values from number `first` on.
    #[inline(always)]
    fn for_each(&self, first: usize, count: usize, mut with: impl FnMut(usize, Goldilocks)) {
        let range = first..first + count;
        match self {
            Self::Narrow(values) => {
                for (index, &value) in values[range].iter().enumerate() {
                    with(index, Goldilocks::from_i64(value.into()));
                }
            }
            Self::Medium(values) => {
                for (index, &value) in values[range].iter().enumerate() {
                    with(index, Goldilocks::from_i64(value.into()));
                }
            }
            Self::Wide(values) => {
                for (index, &value) in values[range].iter().enumerate() {
                    with(index, Goldilocks::from_i64(value));
                }
            }
        }
    }

    /// The value at a point, for the tables of eq over the lower and the upper part of it.
    fn at(&self, low: &[Extension], high: &[Extension]) -> Extension {
        let blocks = high.par_iter().enumerate().map(|(block, &weight)| {
            let mut sums = [Products::default(); 2];
            self.for_each(block * low.len(), low.len(), |index, value| {
                sums[0].add(low[index].0[0], value);
                sums[1].add(low[index].0[1], value);
            });
            weight * Extension(sums.map(Products::reduce))
        });
        blocks.reduce(|| Extension::ZERO, |a, b| a + b)
    }
}

/// Cuts rows of `width` values into columns.
pub fn of_rows(rows: &[Goldilocks], width: usize) -> Vec<Column> {
    let starts: Vec<usize> = (0..width).step_by(LINE).collect();
    let groups = starts.into_par_iter().map(|first| {
        let count = LINE.min(width - first);
        let mut columns = vec![Vec::with_capacity(rows.len() / width); count];
        for row in rows.chunks_exact(width) {
            for (column, &value) in columns.iter_mut().zip(&row[first..]) {
                column.push(value);
            }
        }
        columns.into_iter().map(Column::from).collect::<Vec<_>>()
    });
    groups.flatten_iter().collect()
}

/// The rows, for encoding.
pub fn to_rows(columns: &[Column]) -> Vec<Theirs> {
    let width = columns.len();
    let height = columns.first().map_or(0, Column::len);
    let mut rows = Theirs::zero_vec(width * height);
    let blocks = rows.par_chunks_mut(width * ROWS).enumerate();
    blocks.for_each(|(block, rows)| {
        for (number, column) in columns.iter().enumerate() {
            column.for_each(block * ROWS, rows.len() / width, |row, value| {
                rows[row * width + number] = Theirs::new(value.value());
            });
        }
    });
    rows
}

/// The values of all columns at a point.
pub fn evaluate(columns: &[Column], point: &[Extension]) -> Vec<Extension> {
    let (low, high) = point.split_at(point.len() / 2);
    let (low, high) = (eq_table(low), eq_table(high));
    columns
        .iter()
        .map(|column| column.at(&low, &high))
        .collect()
}

/// Adds `Σ weights · columns`.
pub fn add_combination(columns: &[Column], weights: &[Extension], sums: &mut [Extension]) {
    let blocks = sums.par_chunks_mut(ROWS).enumerate();
    blocks.for_each(|(block, sums)| {
        let mut products = [[Products::default(); 2]; ROWS];
        for (column, weight) in columns.iter().zip(weights) {
            column.for_each(block * ROWS, sums.len(), |row, value| {
                products[row][0].add(weight.0[0], value);
                products[row][1].add(weight.0[1], value);
            });
        }
        for (sum, products) in sums.iter_mut().zip(products) {
            *sum += Extension(products.map(Products::reduce));
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_kept() {
        for (largest, smallest) in [
            (i16::MAX as i64, i16::MIN as i64),
            (i16::MAX as i64 + 1, 0),
            (0, i16::MIN as i64 - 1),
            (i32::MAX as i64, i32::MIN as i64),
            (i32::MAX as i64 + 1, 0),
            (0, i32::MIN as i64 - 1),
            (i64::MAX >> 1, -(i64::MAX >> 1)),
        ] {
            let values = [0, largest, 1, smallest, -1].map(Goldilocks::from_i64);
            let column = Column::from(values.to_vec());
            let mut kept = vec![];
            column.for_each(0, values.len(), |_, value| kept.push(value));
            assert_eq!(kept, values);
        }
    }
}
