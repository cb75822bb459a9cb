//! Look-ups: how often each row of a table is looked up, and the fractions that show it.

use super::counting::{Counting, Index};
use super::reading::{Reader, BLOCK};
use super::tables::Tables;
use crate::field::{Extension, Goldilocks};
use crate::fractions::prove::Stored;
use crate::layout::Layout;
use crate::party::Fold;
use crate::relation::{Atom, Count, Lookup, Term, COLUMNS};
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

fn one(atom: Atom) -> Term {
    Term {
        factor: 1,
        coefficients: None,
        atom,
    }
}

/// The columns of all entries of a look-up.
fn columns(tables: &Tables<'_>, lookup: &Lookup) -> [Vec<i64>; COLUMNS] {
    core::array::from_fn(|column| tables.linear(&lookup.entry[column], &lookup.axes))
}

fn row(columns: &[Vec<i64>; COLUMNS], index: usize) -> [i64; COLUMNS] {
    core::array::from_fn(|column| columns[column][index])
}

/// Whether each entry counts, unless all do.
fn mask<'a>(tables: &Tables<'a>, lookup: &Lookup) -> Option<Reader<'a>> {
    match lookup.count {
        Count::Masked(public) => {
            Some(tables.reader(&vec![one(Atom::Public(public))], &lookup.axes))
        }
        _ => None,
    }
}

/// Reads the entries of a look-up.
struct Entries<'a> {
    columns: [Reader<'a>; COLUMNS],
    mask: Option<Reader<'a>>,
}

/// Room for the entries of a block.
struct Room {
    columns: [[i64; BLOCK]; COLUMNS],
    mask: [i64; BLOCK],
}

impl<'a> Entries<'a> {
    fn new(tables: &Tables<'a>, lookup: &Lookup) -> Self {
        Self {
            columns: core::array::from_fn(|column| {
                tables.reader(&lookup.entry[column], &lookup.axes)
            }),
            mask: mask(tables, lookup),
        }
    }

    /// Calls `with` for each of `count` entries from number `first` on that counts.
    fn for_each(
        &self,
        room: &mut Room,
        first: usize,
        count: usize,
        mut with: impl FnMut(usize, [i64; COLUMNS]),
    ) {
        for (reader, column) in self.columns.iter().zip(&mut room.columns) {
            reader.read(first, &mut column[..count]);
        }
        if let Some(mask) = &self.mask {
            mask.read(first, &mut room.mask[..count]);
        }
        for at in 0..count {
            if self.mask.is_none() || room.mask[at] != 0 {
                let column = |column: usize| room.columns[column][at];
                with(first + at, core::array::from_fn(column));
            }
        }
    }
}

/// For each table, in the order of the look-ups that offer one: how often each of its rows is looked up. Of equal rows the last one has it.
pub fn count(tables: &Tables<'_>) -> Result<Vec<(usize, Vec<i64>)>, NotInTable> {
    let lookups = tables.relations.lookups.iter().enumerate();
    let (offered, others): (Vec<_>, Vec<_>) =
        lookups.partition(|(_, lookup)| matches!(lookup.count, Count::Offered(_)));
    let rows = offered.iter().map(|(_, lookup)| columns(tables, lookup));
    let index = Index::new(rows.collect());
    let entries: Vec<Entries> = others
        .iter()
        .map(|(_, lookup)| Entries::new(tables, lookup))
        .collect();
    let blocks = others.iter().enumerate().flat_map(|(place, (_, lookup))| {
        let size = 1usize << tables.relations.size(&lookup.axes);
        (0..size)
            .step_by(BLOCK)
            .map(move |first| (place, first, BLOCK.min(size - first)))
    });
    let blocks: Vec<(usize, usize, usize)> = blocks.collect();
    // Each core counts for itself.
    let cores = rayon::current_num_threads();
    let counted = (0..cores).into_par_iter().map(|core| {
        let mut counting = Counting::new(&index);
        let mut room = Room {
            columns: [[0; BLOCK]; COLUMNS],
            mask: [0; BLOCK],
        };
        for &(place, first, count) in blocks.iter().skip(core).step_by(cores) {
            entries[place].for_each(&mut room, first, count, |number, entry| {
                counting.add((place, number), entry);
            });
        }
        counting
    });
    let all = counted
        .reduce_with(Counting::plus)
        .unwrap_or_else(|| Counting::new(&index));
    let counts = all.counts().map_err(|((place, index), entry)| NotInTable {
        lookup: others[place].1.name,
        index,
        entry,
    })?;
    Ok(offered
        .iter()
        .map(|(number, _)| *number)
        .zip(counts)
        .collect())
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
        let entries = Entries::new(tables, lookup);
        let (sign, counts) = match lookup.count {
            Count::Offered(number) => {
                let counts = vec![one(Atom::Virtual(number))];
                (-1, Some(tables.reader(&counts, &lookup.axes)))
            }
            _ => (1, mask(tables, lookup)),
        };
        // What is the same in all entries is subtracted once.
        let mut shift = fold.shift;
        let mut columns = vec![];
        for (&power, reader) in fold.powers.iter().zip(&entries.columns) {
            match reader.constant() {
                Some(value) => shift -= power.scale(element(value)),
                None => columns.push((power, reader)),
            }
        }
        let places = offset..offset + size(lookup);
        let denominators = denominators[places.clone()].par_chunks_mut(BLOCK);
        let blocks = numerators[places].par_chunks_mut(BLOCK).zip(denominators);
        blocks
            .enumerate()
            .for_each(|(block, (numerators, denominators))| {
                let mut values = [0; BLOCK];
                let values = &mut values[..numerators.len()];
                denominators.fill(shift);
                for &(power, reader) in &columns {
                    reader.read(block * BLOCK, values);
                    let pairs = denominators.iter_mut().zip(&*values);
                    match power {
                        Extension::ONE => {
                            pairs.for_each(|(target, &value)| target.0[0] -= element(value));
                        }
                        _ => pairs.for_each(|(target, &value)| {
                            *target -= power.scale(element(value));
                        }),
                    }
                }
                match &counts {
                    None => numerators.fill(Goldilocks::ONE),
                    Some(counts) => {
                        counts.read(block * BLOCK, values);
                        for (target, &count) in numerators.iter_mut().zip(&*values) {
                            *target = element(sign * count);
                        }
                    }
                }
            });
    }
    Stored::new(numerators, denominators)
}
