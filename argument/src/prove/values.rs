//! The values of sources, and sums of them with weights.

use crate::commitment::prove::columns::Column;
use crate::field::{Extension, Goldilocks};
use crate::party::Weighted;
use crate::relation::{PartId, Parts};
use rayon::prelude::*;

/// Values that are computed at once, so that they stay in a processor's nearest cache.
pub const BLOCK: usize = 1 << 11;

/// Values of a source.
#[derive(Clone, Copy)]
pub enum SourceValues<'a> {
    /// Weights, as a policy has them.
    Narrow(&'a [i16]),
    /// Anything else.
    Wide(&'a [i64]),
    /// What was committed to: columns, of 2^n values each.
    Columns(&'a [Column], u32),
}

impl SourceValues<'_> {
    /// Drops values that are in files from the process's memory, until somebody uses them again.
    pub fn release(&self) {
        if let Self::Columns(columns, _) = self {
            columns.iter().for_each(Column::release);
        }
    }

    /// Adds the values from number `first` on, times `factor`; nothing after the last one.
    pub fn add(&self, first: usize, factor: i64, sums: &mut [i64]) {
        match self {
            Self::Narrow(values) => add(values.get(first..).unwrap_or_default(), factor, sums),
            Self::Wide(values) => add(values.get(first..).unwrap_or_default(), factor, sums),
            Self::Columns(columns, bits) => {
                let (mut number, mut within) = (first >> bits, first & ((1 << bits) - 1));
                let mut rest = sums;
                while let (false, Some(column)) = (rest.is_empty(), columns.get(number)) {
                    let count = rest.len().min((1 << bits) - within);
                    let (now, later) = rest.split_at_mut(count);
                    match column {
                        Column::Narrow(values) => add(&values[within..], factor, now),
                        Column::Medium(values) => add(&values[within..], factor, now),
                        Column::Wide(values) => add(&values[within..], factor, now),
                    }
                    (number, within, rest) = (number + 1, 0, later);
                }
            }
        }
    }

    /// Value number `index`; zero after the last one.
    #[inline(always)]
    pub fn get(&self, index: usize) -> i64 {
        match self {
            Self::Narrow(values) => values.get(index).map_or(0, |&value| value as i64),
            Self::Wide(values) => values.get(index).copied().unwrap_or_default(),
            Self::Columns(columns, bits) => {
                let column = columns.get(index >> bits);
                column.map_or(0, |column| column.get(index & ((1 << bits) - 1)))
            }
        }
    }
}

/// Adds values times `factor`, as many as there are sums.
pub fn add<T: Copy + Into<i64>>(values: &[T], factor: i64, sums: &mut [i64]) {
    let pairs = sums.iter_mut().zip(values);
    match factor {
        1 => pairs.for_each(|(sum, &value)| *sum = sum.wrapping_add(value.into())),
        _ => pairs.for_each(|(sum, &value)| {
            *sum = sum.wrapping_add(value.into().wrapping_mul(factor));
        }),
    }
}

/// What a claim about these values is about.
pub fn value(values: SourceValues<'_>, parts: &Parts, about: &Weighted) -> Extension {
    let places = about.parts.iter();
    let places = places.map(|&(shift, id)| (shift, parts.get(id).bits()));
    let places: Vec<_> = places.collect();
    let numbers = match packed(&places) {
        Some(bits) => {
            let mut all = vec![0; 1 << bits];
            let blocks = all.par_chunks_mut(BLOCK).enumerate();
            blocks.for_each(|(block, all)| values.add(about.offset + block * BLOCK, 1, all));
            all
        }
        None => {
            let numbers = numbers(about.offset, &places);
            numbers.into_par_iter().map(|n| values.get(n)).collect()
        }
    };
    let ids: Vec<PartId> = about.parts.iter().map(|(_, id)| *id).collect();
    contract(&numbers, parts, &ids)[0]
}

/// The bits of all places together, if the values lie in one piece.
pub fn packed(places: &[(u8, usize)]) -> Option<usize> {
    places.iter().try_fold(0, |end, &(shift, bits)| {
        (shift as usize == end || bits == 0).then_some(end + bits)
    })
}

/// The numbers of the values of a tensor, from the first axis on.
pub fn numbers(offset: usize, places: &[(u8, usize)]) -> Vec<usize> {
    let mut numbers = vec![offset];
    for &(shift, bits) in places {
        let below = numbers.len();
        numbers.reserve(below << bits);
        for index in 1..1 << bits {
            numbers.extend_from_within(..below);
            let last = numbers.len() - below;
            for number in &mut numbers[last..] {
                *number += index << shift;
            }
        }
    }
    numbers
}

/// The sums over the lowest axes of values times weights, one part for each of these axes.
pub fn contract(values: &[i64], parts: &Parts, ids: &[PartId]) -> Vec<Extension> {
    let Some((&first, rest)) = ids.split_first() else {
        let elements = values.par_iter().map(|&v| Goldilocks::from_i64(v).into());
        return elements.collect();
    };
    let weights = parts.get(first).weights();
    let rows = values.par_chunks_exact(weights.len());
    let sum =
        |row: &[i64]| Extension::dot_of(&weights, row.iter().map(|&v| Goldilocks::from_i64(v)));
    let mut sums: Vec<Extension> = rows.map(sum).collect();
    for &id in rest {
        let weights = parts.get(id).weights();
        let rows = sums.par_chunks_exact(weights.len());
        let dot = |row: &[Extension]| row.iter().zip(&weights[..]).map(|(&a, &b)| a * b).sum();
        sums = rows.map(dot).collect();
    }
    sums
}
