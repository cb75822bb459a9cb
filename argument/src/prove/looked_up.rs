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
    let mut rows: FxHashMap<[i64; COLUMNS], (usize, usize)> = FxHashMap::default();
    let mut counts = vec![];
    for (number, lookup) in relations.lookups.iter().enumerate() {
        if let Count::Offered(_) = lookup.count {
            let columns = columns(tables, lookup);
            for index in 0..columns[0].len() {
                rows.insert(row(&columns, index), (counts.len(), index));
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
        // Each core counts a part of the entries.
        let entries = columns[0].len();
        let part = entries.div_ceil(rayon::current_num_threads());
        let parts = (0..entries).into_par_iter().step_by(part.max(1));
        let counted = parts.map(|first| {
            let mut own: Vec<Vec<i64>> = counts.iter().map(|(_, of)| vec![0; of.len()]).collect();
            for index in first..entries.min(first + part) {
                if mask.as_ref().is_some_and(|mask| mask[index] == 0) {
                    continue;
                }
                let entry = row(&columns, index);
                let &(table, row) = rows.get(&entry).ok_or(NotInTable {
                    lookup: lookup.name,
                    index,
                    entry,
                })?;
                own[table][row] += 1;
            }
            Ok(own)
        });
        // The parts are in order, so that the error is about the first entry that no table offers.
        for own in counted.collect::<Vec<Result<_, NotInTable>>>() {
            for ((_, counts), own) in counts.iter_mut().zip(own?) {
                let pairs = counts.iter_mut().zip(own);
                pairs.for_each(|(count, own)| *count += own);
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
