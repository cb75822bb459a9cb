//! Look-ups: how often each row of a table is looked up, and the fractions that show it.

use super::tables::Tables;
use crate::field::{Extension, Goldilocks};
use crate::fractions::prove::Stored;
use crate::layout::Layout;
use crate::party::Fold;
use crate::relation::{Axis, Count, Lookup, Relations, COLUMNS};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

/// Something is looked up that no table offers.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{lookup} at index {index}: {entry:?} is in no table")]
pub struct NotInTable {
    /// Name of the look-up.
    pub lookup: &'static str,
    /// Index of the entry.
    pub index: usize,
    /// Its columns.
    pub entry: [i64; COLUMNS],
}

/// What a prover cannot show, because it is false.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Violation {
    /// An entry is in no table.
    #[error(transparent)]
    NotInTable(#[from] NotInTable),
    /// A table's counts are not those of its entries.
    #[error("{0} are not counted right")]
    Counts(&'static str),
    /// A tensor that has to be zero is not.
    #[error("{equality} does not hold at index {index}")]
    Equality {
        /// Name of the equality.
        equality: &'static str,
        /// Index of the value.
        index: usize,
    },
}

/// Checks every relation on every value, and names the first one that does not hold. It is what an argument shows, without an argument.
pub fn check(tables: &Tables<'_>) -> Result<(), Violation> {
    for (number, counts) in count(tables)? {
        let lookup = &tables.relations.lookups[number];
        if let Count::Offered(view) = lookup.count {
            // Equal rows share their count.
            let said = tables.of_virtual(view, &lookup.axes);
            let columns = columns(tables, lookup);
            let mut sums: FxHashMap<[i64; COLUMNS], i64> = FxHashMap::default();
            for (index, (said, count)) in said.iter().zip(&counts).enumerate() {
                if said != count {
                    *sums.entry(row(&columns, index)).or_default() += said - count;
                }
            }
            if sums.values().any(|&difference| difference != 0) {
                return Err(Violation::Counts(lookup.name));
            }
        }
    }
    check_equalities(tables)
}

/// Checks the equalities alone.
pub fn check_equalities(tables: &Tables<'_>) -> Result<(), Violation> {
    for equality in &tables.relations.equalities {
        let values = tables.linear(&equality.linear, &equality.axes);
        if let Some(index) = values.iter().position(|&value| value != 0) {
            let equality = equality.name;
            return Err(Violation::Equality { equality, index });
        }
    }
    Ok(())
}

/// The columns of all entries of a look-up.
fn columns(tables: &Tables<'_>, lookup: &Lookup) -> [Vec<i64>; COLUMNS] {
    core::array::from_fn(|column| tables.linear(&lookup.entry[column], &lookup.axes))
}

fn row(columns: &[Vec<i64>; COLUMNS], index: usize) -> [i64; COLUMNS] {
    core::array::from_fn(|column| columns[column][index])
}

/// Whether each entry counts.
fn mask(tables: &Tables<'_>, number: usize, axes: &[Axis]) -> Vec<i64> {
    tables.public(number, axes)
}

/// For each table, in the order of the look-ups that offer one: how often each of its rows is looked up. Of equal rows the last one has it.
pub fn count(tables: &Tables<'_>) -> Result<Vec<(usize, Vec<i64>)>, NotInTable> {
    let relations: &Relations = tables.relations;
    let offered = |lookup: &&Lookup| matches!(lookup.count, Count::Offered(_));
    let sizes = relations.lookups.iter().filter(offered);
    let sizes = sizes.map(|lookup| 1 << relations.size(&lookup.axes));
    let mut rows: FxHashMap<[i64; COLUMNS], (u32, u32)> =
        FxHashMap::with_capacity_and_hasher(sizes.sum(), Default::default());
    let mut counts = vec![];
    for (number, lookup) in relations.lookups.iter().enumerate() {
        if offered(&lookup) {
            let columns = columns(tables, lookup);
            for index in 0..columns[0].len() {
                rows.insert(row(&columns, index), (counts.len() as u32, index as u32));
            }
            counts.push((number, vec![0; columns[0].len()]));
        }
    }
    for lookup in &relations.lookups {
        let mask = match lookup.count {
            Count::Offered(_) => continue,
            Count::Each => None,
            Count::Masked(public) => Some(mask(tables, public, &lookup.axes)),
        };
        let columns = columns(tables, lookup);
        // Each core looks up a part of the entries.
        let entries = columns[0].len();
        let part = entries.div_ceil(rayon::current_num_threads()).max(1);
        let parts = (0..entries).into_par_iter().step_by(part);
        let found = parts.map(|first| {
            (first..entries.min(first + part))
                .filter(|&index| mask.as_ref().is_none_or(|mask| mask[index] != 0))
                .map(|index| {
                    let entry = row(&columns, index);
                    rows.get(&entry).copied().ok_or(NotInTable {
                        lookup: lookup.name,
                        index,
                        entry,
                    })
                })
                .collect()
        });
        // The parts are in order, so that the error is about the first entry that no table offers.
        for found in found.collect::<Vec<Result<Vec<(u32, u32)>, NotInTable>>>() {
            for (table, row) in found? {
                counts[table as usize].1[row as usize] += 1;
            }
        }
    }
    Ok(counts)
}

/// The fractions of all look-ups.
pub fn leaves(tables: &Tables<'_>, layout: &Layout, fold: &Fold) -> Stored<Goldilocks> {
    let size = |lookup: &Lookup| 1usize << tables.relations.size(&lookup.axes);
    let lookups = tables.relations.lookups.iter().zip(&layout.offsets);
    let ends = lookups
        .clone()
        .map(|(lookup, offset)| offset + size(lookup));
    let used = ends.max().unwrap_or_default();
    let mut numerators = vec![Goldilocks::ZERO; used];
    let mut denominators = vec![Extension::ONE; used];
    let element = |value: i64| Goldilocks::from_i64(value);
    for (lookup, &offset) in lookups {
        let places = offset..offset + size(lookup);
        let targets = &mut denominators[places.clone()];
        targets.fill(fold.shift);
        for (&power, column) in fold.powers.iter().zip(&lookup.entry) {
            if column.is_empty() {
                continue;
            }
            let values = tables.linear(column, &lookup.axes);
            let pairs = targets.par_iter_mut().zip(values);
            pairs.for_each(|(target, value)| *target -= power.scale(element(value)));
        }
        let targets = &mut numerators[places];
        let counts = match lookup.count {
            Count::Each => {
                targets.fill(Goldilocks::ONE);
                continue;
            }
            Count::Masked(public) => mask(tables, public, &lookup.axes),
            Count::Offered(number) => tables.of_virtual(number, &lookup.axes),
        };
        let sign = match lookup.count {
            Count::Offered(_) => -1,
            _ => 1,
        };
        let pairs = targets.par_iter_mut().zip(counts);
        pairs.for_each(|(target, count)| *target = element(sign * count));
    }
    Stored::new(numerators, denominators)
}
