//! The values of committed tensors, computed step by step from the relations that they have to obey.

use super::looked_up::{count, NotInTable};
use super::tables::{Computed, Tables};
use super::values::{numbers, packed, SourceValues, BLOCK};
use crate::relation::along::Along;
use crate::relation::{Atom, Axis, Committed, Count, LinearSum, Relations};
use rayon::prelude::*;

/// Values of all sources. Those that are committed to are filled in.
pub struct Filling<'a> {
    /// What the values have to obey.
    pub relations: &'a Relations,
    /// What is committed to.
    pub main: Vec<i64>,
    /// The samples.
    pub data: &'a [i64],
    /// The weights.
    pub weights: &'a [i16],
    /// Columns of tables.
    pub tables: &'a [i64],
    /// Sums of products. A step computes them when the values that they are made from are filled in, and no later step changes these.
    pub computed: Computed,
}

impl Filling<'_> {
    /// The values of all sources, by number.
    pub fn sources(&self) -> [SourceValues<'_>; 4] {
        [
            SourceValues::Wide(&self.main),
            SourceValues::Wide(self.data),
            SourceValues::Narrow(self.weights),
            SourceValues::Wide(self.tables),
        ]
    }

    fn with<R>(&self, f: impl FnOnce(&Tables<'_>) -> R) -> R {
        f(&Tables {
            relations: self.relations,
            sources: &self.sources(),
            computed: &self.computed,
        })
    }

    /// The values of a sum of terms.
    pub fn linear(&self, linear: &LinearSum, axes: &[Axis]) -> Vec<i64> {
        self.with(|tables| tables.linear(linear, axes))
    }

    /// A number that may differ along an axis, for each value of a tensor with these axes.
    pub fn along(&self, numbers: &Along, axes: &[Axis]) -> Vec<i64> {
        let count = 1 << self.relations.size(axes);
        match numbers {
            Along::Everywhere(number) => vec![*number; count],
            Along::Axis(axis, numbers) => {
                let below = axes.iter().take_while(|of| *of != axis).copied();
                let below = self.relations.size(&below.collect::<Vec<_>>());
                let mask = numbers.len() - 1;
                (0..count)
                    .map(|index| numbers[index >> below & mask])
                    .collect()
            }
        }
    }

    /// `plus + ⌊value / 2^shift⌋`, and zero where it does not count.
    pub fn shifted(
        &self,
        (value, plus): (&LinearSum, Option<Committed>),
        shift: &Along,
        count: Count,
        axes: &[Axis],
    ) -> Vec<i64> {
        let mut values = vec![0; 1 << self.relations.size(axes)];
        self.with(|tables| {
            let value = tables.reader(value, axes);
            let shift = tables.along(shift, axes);
            let plus = plus.map(|plus| tables.atom(plus.atom(), axes));
            let mask = match count {
                Count::Masked(public) => Some(tables.atom(Atom::Public(public), axes)),
                _ => None,
            };
            let blocks = values.par_chunks_mut(BLOCK).enumerate();
            blocks.for_each(|(block, values)| {
                let first = block * BLOCK;
                let mut others = [0; BLOCK];
                let others = &mut others[..values.len()];
                value.read(first, values);
                shift.read(first, others);
                for (value, &mut shift) in values.iter_mut().zip(&mut *others) {
                    *value >>= shift;
                }
                if let Some(plus) = &plus {
                    plus.read(first, others);
                    for (value, &mut plus) in values.iter_mut().zip(&mut *others) {
                        *value += plus;
                    }
                }
                if let Some(mask) = &mask {
                    mask.read(first, others);
                    for (value, &mut mask) in values.iter_mut().zip(others) {
                        *value *= mask;
                    }
                }
            });
        });
        values
    }

    /// Saturates the values of the base, whose half `base` states, and fills in by how much they exceeded each limit, on the axes `own`.
    pub fn saturate(
        &mut self,
        values: &mut [i64],
        axes: &[Axis],
        base: &Along,
        own: &[Axis],
        limits: &[(i64, i64, Committed)],
    ) {
        let base = self.along(base, axes);
        for &(sign, limit, excess) in limits {
            let all = values.iter_mut().zip(&base).filter(|(_, &base)| base == 1);
            let excesses: Vec<i64> = all
                .map(|(value, _)| {
                    let excess = (sign * (*value - limit)).max(0);
                    *value -= sign * excess;
                    excess
                })
                .collect();
            self.set(excess, own, &excesses);
        }
    }

    /// Sets those values to zero that do not count.
    pub fn keep_counted(&self, count: Count, axes: &[Axis], values: &mut [i64]) {
        if let Count::Masked(public) = count {
            let mask = self.with(|tables| tables.public(public, axes));
            for (value, mask) in values.iter_mut().zip(mask) {
                *value *= mask;
            }
        }
    }

    /// Fills a tensor.
    pub fn set(&mut self, tensor: Committed, axes: &[Axis], values: &[i64]) {
        let tensor = &self.relations.tensors[tensor.tensor];
        debug_assert_eq!(axes.len(), tensor.places.len());
        let places = tensor.places.iter();
        let places: Vec<_> = places
            .map(|place| (place.shift, place.bits as usize))
            .collect();
        match packed(&places) {
            Some(_) => self.main[tensor.offset..][..values.len()].copy_from_slice(values),
            None => {
                for (number, &value) in numbers(tensor.offset, &places).into_iter().zip(values) {
                    self.main[number] = value;
                }
            }
        }
    }

    /// Fills in how often each row of a table is looked up.
    pub fn count(&mut self) -> Result<(), NotInTable> {
        let counts = self.with(count)?;
        for (number, counts) in counts {
            let lookup = &self.relations.lookups[number];
            if let Count::Offered(view) = lookup.count {
                let tensor = self.relations.virtuals[view].views[0].tensor;
                self.set(Committed { tensor, view }, &lookup.axes, &counts);
            }
        }
        Ok(())
    }
}
