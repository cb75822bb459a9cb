//! How often each row of a table is looked up.
//!
//! Nearly all entries are looked up in tables whose rows have small numbers: those of a column, or of one column for each of a few values of another
//! one. There, the number of an entry's row stands in an array. What is looked up in any other table is collected first, and compared with its rows
//! at the end.

use crate::relation::COLUMNS;
use rayon::prelude::*;
use rustc_hash::FxHashMap;

/// The column that tells tables apart.
const TAG: usize = COLUMNS - 1;
/// Most values of the second column for which a table has an array each.
const CLASSES: usize = 64;
/// Entries of arrays for each row of a table, at most.
const SPARE: usize = 4;

type LookupRow = [i64; COLUMNS];
type LookupColumns = [Vec<i64>; COLUMNS];
/// Which look-up an entry is of, and which number it has there.
type LookupPosition = (usize, usize);

/// Rows with equal values in one column, or all.
struct Class {
    of: i64,
    /// The value of the first column of the first one.
    least: i64,
    /// The number of the row for each value from there on, plus one; 0 if there is none.
    rows: Vec<u32>,
}

/// Where rows are in arrays.
struct Dense {
    /// The column that tells classes apart.
    by: Option<usize>,
    classes: Vec<Class>,
}

impl Dense {
    fn new(rows: &LookupColumns, by: Option<usize>) -> Option<Self> {
        let mut ranges: Vec<(i64, [i64; 2])> = vec![];
        for (row, &value) in rows[0].iter().enumerate() {
            let of = by.map_or(0, |by| rows[by][row]);
            match ranges.iter().rposition(|(class, _)| *class == of) {
                Some(known) => {
                    let [least, most] = &mut ranges[known].1;
                    (*least, *most) = (value.min(*least), value.max(*most));
                }
                None if ranges.len() == CLASSES => return None,
                None => ranges.push((of, [value; 2])),
            }
        }
        let sizes = ranges
            .iter()
            .map(|(_, [least, most])| most.abs_diff(*least));
        let size = sizes.fold(0u64, |sum, size| sum.saturating_add(size).saturating_add(1));
        if size > (SPARE * rows[0].len()) as u64 {
            return None;
        }
        let classes = ranges.into_iter().map(|(of, [least, most])| Class {
            of,
            least,
            rows: vec![0; (most - least + 1) as usize],
        });
        let classes = classes.collect();
        let mut dense = Self { by, classes };
        for row in 0..rows[0].len() {
            let entry = at(rows, row);
            let (class, index) = dense.place(&entry)?;
            let place = &mut dense.classes[class].rows[index];
            let known = core::mem::replace(place, row as u32 + 1);
            if known > 0 && at(rows, known as usize - 1) != entry {
                return None;
            }
        }
        Some(dense)
    }

    /// The class of an entry, and its place there.
    #[inline(always)]
    fn place(&self, entry: &LookupRow) -> Option<(usize, usize)> {
        let of = self.by.map_or(0, |by| entry[by]);
        let class = self.classes.iter().rposition(|class| class.of == of)?;
        let index = entry[0].checked_sub(self.classes[class].least)?;
        Some((class, usize::try_from(index).ok()?))
    }

    /// The row that is equal to an entry.
    #[inline(always)]
    fn row(&self, rows: &LookupColumns, entry: &LookupRow) -> Option<usize> {
        let (class, index) = self.place(entry)?;
        let row = *self.classes[class].rows.get(index)? as usize;
        let row = row.checked_sub(1)?;
        (at(rows, row) == *entry).then_some(row)
    }
}

fn at(rows: &LookupColumns, row: usize) -> LookupRow {
    core::array::from_fn(|column| rows[column][row])
}

/// Tables with one tag.
struct TableGroup {
    tag: i64,
    /// Their numbers.
    tables: Vec<usize>,
    /// The rows of all, one table after the other.
    rows: LookupColumns,
    dense: Option<Dense>,
}

/// Where an entry's row is.
pub struct RowIndex {
    /// How many rows each table has.
    sizes: Vec<usize>,
    groups: Vec<TableGroup>,
}

impl RowIndex {
    /// Of these tables, by columns.
    pub fn new(tables: Vec<LookupColumns>) -> Self {
        let sizes = tables.iter().map(|rows| rows[0].len()).collect();
        let mut groups: Vec<TableGroup> = vec![];
        for (number, rows) in tables.into_iter().enumerate() {
            let tag = rows[TAG].first().copied().unwrap_or_default();
            match groups.iter_mut().find(|group| group.tag == tag) {
                Some(group) => {
                    group.tables.push(number);
                    for (all, own) in group.rows.iter_mut().zip(rows) {
                        all.extend(own);
                    }
                }
                None => groups.push(TableGroup {
                    tag,
                    tables: vec![number],
                    rows,
                    dense: None,
                }),
            }
        }
        let has_one_tag = |group: &TableGroup| group.rows[TAG].iter().all(|&tag| tag == group.tag);
        if groups.iter().all(has_one_tag) {
            groups.par_iter_mut().for_each(|group| {
                let ways = (1..TAG).map(Some);
                let mut ways = [None].into_iter().chain(ways);
                group.dense = ways.find_map(|by| Dense::new(&group.rows, by));
            });
        }
        Self { sizes, groups }
    }
}

/// What was counted.
pub struct Counting<'a> {
    index: &'a RowIndex,
    /// For each group in arrays, how often each row is looked up.
    dense: Vec<Vec<u32>>,
    /// All other entries, with the first place of each.
    others: FxHashMap<LookupRow, (u32, LookupPosition)>,
    /// The first entry that is in no array.
    missing: Option<(LookupPosition, LookupRow)>,
}

impl<'a> Counting<'a> {
    /// Nothing.
    pub fn new(index: &'a RowIndex) -> Self {
        let dense = index.groups.iter().map(|group| match group.dense {
            Some(_) => vec![0; group.rows[0].len()],
            None => vec![],
        });
        Self {
            index,
            dense: dense.collect(),
            others: FxHashMap::default(),
            missing: None,
        }
    }

    /// Counts an entry.
    #[inline(always)]
    pub fn add(&mut self, place: LookupPosition, entry: LookupRow) {
        let groups = &self.index.groups;
        let number = groups.iter().position(|group| group.tag == entry[TAG]);
        let group = number.map(|number| (number, &groups[number]));
        if let Some((
            number,
            TableGroup {
                rows,
                dense: Some(dense),
                ..
            },
        )) = group
        {
            match dense.row(rows, &entry) {
                Some(row) => self.dense[number][row] += 1,
                None => self.miss((place, entry)),
            }
            return;
        }
        let (count, first) = self.others.entry(entry).or_insert((0, place));
        *count += 1;
        *first = place.min(*first);
    }

    #[cold]
    fn miss(&mut self, missing: (LookupPosition, LookupRow)) {
        let known = self.missing.take().unwrap_or(missing);
        self.missing = Some(known.min(missing));
    }

    /// What both have counted.
    pub fn plus(mut self, other: Self) -> Self {
        for (own, others) in self.dense.iter_mut().zip(other.dense) {
            for (own, other) in own.iter_mut().zip(others) {
                *own += other;
            }
        }
        for (entry, (count, place)) in other.others {
            let own = self.others.entry(entry).or_insert((0, place));
            *own = (own.0 + count, place.min(own.1));
        }
        if let Some(missing) = other.missing {
            self.miss(missing);
        }
        self
    }

    /// The counts of each table's rows, or the first entry that is in no table.
    pub fn counts(mut self) -> Result<Vec<Vec<i64>>, (LookupPosition, LookupRow)> {
        let mut counts = vec![vec![]; self.index.sizes.len()];
        for (group, own) in self.index.groups.iter().zip(&mut self.dense) {
            if group.dense.is_none() {
                own.resize(group.rows[0].len(), 0);
                // Of equal rows the last one counts.
                for row in (0..own.len()).rev() {
                    let other = self.others.remove(&at(&group.rows, row));
                    own[row] = other.map_or(0, |(count, _)| count);
                }
            }
            let mut rest = &own[..];
            for &table in &group.tables {
                let (now, later) = rest.split_at(self.index.sizes[table]);
                counts[table] = now.iter().map(|&count| count.into()).collect();
                rest = later;
            }
        }
        let others = self
            .others
            .into_iter()
            .map(|(entry, (_, place))| (place, entry));
        match others.chain(self.missing).min() {
            Some(missing) => Err(missing),
            None => Ok(counts),
        }
    }
}
