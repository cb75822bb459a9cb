//! Look-ups: how often each row of a table is looked up, and the fractions that show it.

use super::counting::{Counting, RowIndex};
use super::reading::{all, narrowed, SumReader};
use super::tables::Tables;
use super::values::{SourceValues, BLOCK};
use crate::commitment::prove::columns::Column;
use crate::field::{Extension, Goldilocks};
use crate::fractions::prove::Leaves;
use crate::layout::LookupLayout;
use crate::party::Fold;
use crate::relation::{Atom, Count, Lookup, COLUMNS};
use core::ops::Range;
use core::slice;
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

/// Whether each entry counts, unless all do.
fn mask<'a>(tables: &Tables<'a>, lookup: &Lookup) -> Option<SumReader<'a>> {
    match lookup.count {
        Count::Masked(public) => Some(tables.atom(Atom::Public(public), &lookup.axes)),
        _ => None,
    }
}

/// Reads the entries of a look-up.
struct Entries<'a> {
    columns: [SumReader<'a>; COLUMNS],
    mask: Option<SumReader<'a>>,
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
    let index = RowIndex::new(rows.collect());
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

/// The fractions of one look-up.
struct FractionPiece<'a> {
    /// The first leaf, and the one after the last.
    leaves: Range<usize>,
    /// The first column of all entries, which may take long to compute.
    first: Column,
    /// What is the same in all denominators.
    shift: Extension,
    /// The other columns, and what they are multiplied with.
    columns: Vec<(Extension, SumReader<'a>)>,
    /// The numerators, but for their sign; all are 1 if there is none.
    counts: Option<SumReader<'a>>,
    sign: i64,
}

/// The fractions of all look-ups, which are put together when they are read: that takes less time than to read them from memory, and a sixth of it.
pub struct Fractions<'a>(Vec<FractionPiece<'a>>);

impl<'a> Fractions<'a> {
    /// Of one instance.
    pub fn new(tables: &Tables<'a>, layout: &LookupLayout, fold: &Fold) -> Self {
        let lookups = tables.relations.lookups.iter().zip(&layout.offsets);
        let pieces = lookups.map(|(lookup, &offset)| {
            let reader = |column: usize| tables.reader(&lookup.entry[column], &lookup.axes);
            let size = 1usize << tables.relations.size(&lookup.axes);
            let mut shift = fold.shift;
            let mut columns = vec![];
            for (column, &power) in fold.powers.iter().enumerate().skip(1) {
                let reader = reader(column);
                match reader.constant() {
                    Some(value) => shift -= power.scale(Goldilocks::from_i64(value)),
                    None => columns.push((power, reader)),
                }
            }
            let (sign, counts) = match lookup.count {
                Count::Each => (1, None),
                Count::Masked(public) => (1, Some(Atom::Public(public))),
                Count::Offered(number) => (-1, Some(Atom::Virtual(number))),
            };
            FractionPiece {
                leaves: offset..offset + size,
                first: kept(&reader(0), size),
                shift,
                columns,
                counts: counts.map(|atom| tables.atom(atom, &lookup.axes)),
                sign,
            }
        });
        let mut pieces: Vec<FractionPiece> = pieces.collect();
        pieces.sort_by_key(|piece| piece.leaves.start);
        Self(pieces)
    }
}

/// Values in as few bytes as most of them need.
fn kept(reader: &SumReader<'_>, count: usize) -> Column {
    let read = |first: usize, values: &mut [i64]| reader.read(first, values);
    match narrowed::<i32>(count, read) {
        Some(values) => Column::Medium(values.into()),
        None => Column::Wide(all(count, read).into()),
    }
}

impl FractionPiece<'_> {
    fn read(&self, first: usize, numerators: &mut [Goldilocks], denominators: &mut [Extension]) {
        let element = Goldilocks::from_i64;
        let mut values = [0; BLOCK];
        let values = &mut values[..numerators.len()];
        let bits = self.leaves.len().ilog2();
        SourceValues::Columns(slice::from_ref(&self.first), bits).add(first, 1, values);
        for (target, &value) in denominators.iter_mut().zip(&*values) {
            *target = Extension([self.shift.0[0] - element(value), self.shift.0[1]]);
        }
        for (power, reader) in &self.columns {
            reader.read(first, values);
            for (target, &value) in denominators.iter_mut().zip(&*values) {
                *target -= power.scale(element(value));
            }
        }
        match &self.counts {
            None => numerators.fill(Goldilocks::ONE),
            Some(counts) => {
                counts.read(first, values);
                for (target, &count) in numerators.iter_mut().zip(&*values) {
                    *target = element(self.sign * count);
                }
            }
        }
    }
}

impl Leaves for Fractions<'_> {
    type Numerator = Goldilocks;

    fn len(&self) -> usize {
        self.0.last().map_or(0, |piece| piece.leaves.end)
    }

    fn read(
        &self,
        mut first: usize,
        mut numerators: &mut [Goldilocks],
        mut denominators: &mut [Extension],
    ) {
        let mut pieces = &self.0[self.0.partition_point(|piece| piece.leaves.end <= first)..];
        while let (false, Some(piece)) = (numerators.is_empty(), pieces.first()) {
            let count = numerators.len().min(piece.leaves.end - first).min(BLOCK);
            let (own, later) = numerators.split_at_mut(count);
            let (other, rest) = denominators.split_at_mut(count);
            piece.read(first - piece.leaves.start, own, other);
            (numerators, denominators) = (later, rest);
            first += count;
            if first == piece.leaves.end {
                pieces = &pieces[1..];
            }
        }
    }
}
