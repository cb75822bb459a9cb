//! Builds relations: commits to tensors, and states what holds of them. Beside each relation stands how the prover gets the values.

use super::sizes::{Sizes, R, S};
use crate::field::Goldilocks;
use crate::layout::from_largest;
#[cfg(feature = "prove")]
use crate::prove::filling::Filling;
use crate::relation::along::Along;
use crate::relation::{
    Atom, Axis, AxisPlace, ColumnSource, Committed, Count, Equality, Factor, Index, LinearSum,
    Lookup, Monomials, Relations, Tensor, Term, View, Virtual,
};
#[cfg(feature = "prove")]
use alloc::boxed::Box;
use alloc::vec;
use alloc::vec::Vec;
#[cfg(feature = "prove")]
use rayon::prelude::*;

/// What the prover commits to for each sample: the values of both evaluations.
pub const MAIN: ColumnSource = ColumnSource(0);
/// The samples.
pub const DATA: ColumnSource = ColumnSource(1);
/// The weights of both models.
pub const WEIGHTS: ColumnSource = ColumnSource(2);
/// Columns of tables.
pub const TABLES: ColumnSource = ColumnSource(3);

/// Tells the entries of a table from those of others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tag {
    /// A value, and bits within which it is.
    Range,
    /// A distance to the largest score, a power of two, and whether the score is seen.
    Power,
    /// A score, the number of its row, and whether it is seen.
    Score,
    /// A gate with so many fraction bits, and its product with the logistic function.
    Gate(u8),
}

impl Tag {
    /// The tag as a number.
    pub fn number(self) -> i64 {
        match self {
            Self::Range => 0,
            Self::Power => 1,
            Self::Score => 2,
            Self::Gate(bits) => 3 + bits as i64,
        }
    }
}

/// A step with which the prover computes values.
#[cfg(feature = "prove")]
pub type TraceStep = Box<dyn Fn(&mut Filling<'_>) + Send + Sync>;

/// Builds relations.
pub struct Builder {
    /// Sizes of axes.
    pub sizes: Sizes,
    /// What holds.
    pub relations: Relations,
    /// Whether values of the base saturate.
    pub saturates: bool,
    /// Tensors of each source without a place yet, with the bits of their axes but that of samples.
    waiting: Vec<(usize, Vec<Axis>)>,
    /// How the prover computes the values, in this order.
    #[cfg(feature = "prove")]
    pub steps: Vec<TraceStep>,
}

/// What becomes of values of the base that do not fit int16.
#[derive(Clone, Debug)]
pub struct Saturating {
    /// The axis whose lower half is the base's, and whose upper half is the update's.
    pub models: Axis,
    /// Values exceed int16 by less than 2^bits.
    pub bits: Along,
}

/// What is committed to of values that exceed a limit: by how much, on the axes with the base's half alone.
struct Excess {
    /// 1 for the upper limit, −1 for the lower one.
    sign: i64,
    limit: i64,
    committed: Committed,
    /// The same on all axes, with zeros for the update.
    view: usize,
}

/// Bits of the number of a value, of so many.
pub fn bits_of(values: usize) -> u8 {
    values.next_power_of_two().trailing_zeros() as u8
}

/// Axes with that of one model in place of both models'.
fn of_one_model(axes: &[Axis], models: Axis) -> Vec<Axis> {
    let own = axes.iter().map(|&axis| {
        if axis == models {
            Sizes::of_one_model(axis)
        } else {
            axis
        }
    });
    own.collect()
}

/// `atom`, once.
pub fn one(atom: Atom) -> Term {
    times(1, atom)
}

/// `factor · atom`.
pub fn times(factor: i64, atom: Atom) -> Term {
    Term {
        factor,
        coefficients: None,
        atom,
    }
}

/// `2^exponent`.
pub fn power_of_two(exponent: i64) -> i64 {
    1 << exponent
}

impl Builder {
    /// Builds relations of tensors with axes of these sizes.
    pub fn new(sizes: Sizes) -> Self {
        let relations = Relations {
            axes: sizes.bits.clone(),
            published: vec![WEIGHTS, TABLES],
            ..Default::default()
        };
        Self {
            sizes,
            relations,
            saturates: false,
            waiting: vec![],
            #[cfg(feature = "prove")]
            steps: vec![],
        }
    }

    /// Adds a step of the prover's.
    #[cfg(feature = "prove")]
    pub fn step(&mut self, step: impl Fn(&mut Filling<'_>) + Send + Sync + 'static) {
        self.steps.push(Box::new(step));
    }

    /// A tensor of a source with these axes.
    pub fn tensor(&mut self, name: &'static str, source: ColumnSource, axes: &[Axis]) -> Committed {
        let tensor = self.relations.tensors.len();
        let places = axes.iter().map(|_| AxisPlace { shift: 0, bits: 0 });
        self.relations.tensors.push(Tensor {
            name,
            source,
            offset: 0,
            places: places.collect(),
        });
        self.waiting.push((tensor, axes.to_vec()));
        let indices: Vec<Index> = axes.iter().map(|&axis| Index::Of(axis)).collect();
        let view = self.view(tensor, &indices);
        Committed { tensor, view }
    }

    /// A tensor that the prover commits to.
    pub fn commit(&mut self, name: &'static str, axes: &[Axis]) -> Committed {
        self.tensor(name, MAIN, axes)
    }

    /// A tensor seen with other axes.
    pub fn view(&mut self, tensor: usize, indices: &[Index]) -> usize {
        self.views(vec![(tensor, indices.to_vec())])
    }

    /// The sum of several views.
    pub fn views(&mut self, views: Vec<(usize, Vec<Index>)>) -> usize {
        let views = views.into_iter().map(|(tensor, indices)| View {
            tensor,
            indices,
            only: vec![],
            factor: 1,
        });
        let views = views.collect();
        self.relations.virtuals.push(Virtual { views });
        self.relations.virtuals.len() - 1
    }

    /// A map from the indices of one axis.
    pub fn map(&mut self, from: Axis, map: impl Fn(usize) -> Option<usize>) -> usize {
        let places = (0..self.sizes.count(from)).map(|index| map(index).map(|to| to as u16));
        let places: Vec<Option<u16>> = places.collect();
        let maps = &mut self.relations.maps;
        match maps.iter().position(|known| *known == places) {
            Some(known) => known,
            None => {
                maps.push(places);
                maps.len() - 1
            }
        }
    }

    /// `number · factor · atom`.
    pub fn scaled(&mut self, number: &Along, factor: i64, atom: Atom) -> Term {
        match number {
            Along::Everywhere(number) => times(number * factor, atom),
            Along::Axis(axis, numbers) => {
                let values = numbers.iter().map(|&number| Goldilocks::from_i64(number));
                let values = (*axis, values.collect::<Vec<_>>());
                let all = &mut self.relations.coefficients;
                let known = all.iter().position(|known| *known == values);
                let coefficients = known.unwrap_or_else(|| {
                    all.push(values);
                    all.len() - 1
                });
                Term {
                    factor,
                    coefficients: Some(coefficients),
                    atom,
                }
            }
        }
    }

    /// Every entry of `columns` is a row of the table with this tag.
    pub fn look_up(
        &mut self,
        name: &'static str,
        axes: &[Axis],
        count: Count,
        columns: [LinearSum; 3],
        tag: LinearSum,
    ) {
        let [a, b, c] = columns;
        self.relations.lookups.push(Lookup {
            name,
            axes: axes.to_vec(),
            count,
            entry: [a, b, c, tag],
        });
    }

    /// `0 ≤ value < 2^bits`, where there are up to [`Sizes::limb`] bits.
    pub fn range(
        &mut self,
        name: &'static str,
        axes: &[Axis],
        count: Count,
        value: LinearSum,
        bits: &Along,
    ) {
        let bits = vec![self.scaled(bits, 1, Atom::One)];
        self.look_up(name, axes, count, [value, bits, vec![]], vec![]);
    }

    /// `0 ≤ value < 2^bits`, for any number of bits up to 62: all but the lowest limb are committed to.
    pub fn wide_range(
        &mut self,
        name: &'static str,
        axes: &[Axis],
        count: Count,
        value: LinearSum,
        bits: &Along,
    ) {
        let limb = self.sizes.limb as i64;
        let own = |number: i64| bits.map(move |bits| (bits - number * limb).clamp(0, limb));
        let limbs = (bits.most() + limb - 1) / limb;
        let mut lowest = value.clone();
        for number in 1..limbs {
            let high = self.commit(name, axes);
            #[cfg(feature = "prove")]
            {
                let (value, axes) = (value.clone(), axes.to_vec());
                let last = number + 1 == limbs;
                self.step(move |filling| {
                    let shift = Along::Everywhere(number * limb);
                    let mut values = filling.shifted((&value, None), &shift, count, &axes);
                    if !last {
                        let mask = (1 << limb) - 1;
                        values.par_iter_mut().for_each(|value| *value &= mask);
                    }
                    filling.set(high, &axes, &values);
                });
            }
            self.range(name, axes, count, vec![one(high.atom())], &own(number));
            lowest.push(times(-1 << (number * limb), high.atom()));
        }
        self.range(name, axes, count, lowest, &own(0));
    }

    /// A committed int16 tensor `⌊value / 2^shift⌋`.
    pub fn floor(
        &mut self,
        name: &'static str,
        axes: &[Axis],
        count: Count,
        value: LinearSum,
        shift: &Along,
        saturating: Option<Saturating>,
    ) -> Committed {
        let result = self.commit(name, axes);
        let within = Along::Everywhere(16);
        let shifts = (shift, Some(&within));
        self.floor_into(result, axes, count, (value, None), shifts, saturating);
        result
    }

    /// `result = plus + ⌊value / 2^shift⌋`, which has up to `bits` bits with its sign, or is looked up in a table of int16. Where it does not fit int16, it is the nearest value that does,
    /// if that is the base's and the statement states it.
    pub fn floor_into(
        &mut self,
        result: Committed,
        axes: &[Axis],
        count: Count,
        (value, plus): (LinearSum, Option<Committed>),
        (shift, bits): (&Along, Option<&Along>),
        saturating: Option<Saturating>,
    ) {
        let name = self.relations.tensors[result.tensor].name;
        let saturating = saturating.filter(|_| self.saturates);
        let excesses = saturating
            .as_ref()
            .map_or(vec![], |by| self.excesses(name, axes, by.models));
        #[cfg(feature = "prove")]
        {
            let (value, axes, shift) = (value.clone(), axes.to_vec(), shift.clone());
            let base = saturating.as_ref().map(|by| self.is_of_base(by.models));
            let own = saturating.as_ref().map(|by| of_one_model(&axes, by.models));
            let committed: Vec<_> = excesses
                .iter()
                .map(|excess| (excess.sign, excess.limit, excess.committed))
                .collect();
            self.step(move |filling| {
                let mut values = filling.shifted((&value, plus), &shift, count, &axes);
                if let (Some(base), Some(own)) = (&base, &own) {
                    filling.saturate(&mut values, &axes, base, own, &committed);
                }
                filling.set(result, &axes, &values);
            });
        }
        let power = shift.map(power_of_two);
        let mut rest = value;
        rest.push(self.scaled(&power, -1, result.atom()));
        if let Some(plus) = plus {
            rest.push(self.scaled(&power, 1, plus.atom()));
        }
        for excess in &excesses {
            rest.push(self.scaled(&power, -excess.sign, Atom::Virtual(excess.view)));
        }
        if let Some(Saturating { models, bits }) = saturating {
            let bits = self.of_base(&bits, models);
            let own = of_one_model(axes, models);
            for excess in excesses {
                let value = vec![one(excess.committed.atom())];
                self.wide_range(name, &own, count, value, &bits);
                self.at_limit(name, axes, (excess.view, excess.limit), result);
            }
        }
        self.wide_range(name, axes, count, rest, shift);
        if let Some(bits) = bits {
            let half = bits.map(|bits| 1 << (bits - 1));
            let above = vec![one(result.atom()), self.scaled(&half, 1, Atom::One)];
            self.range(name, axes, count, above, bits);
        }
    }

    /// By how much values of the base exceed int16, above and below.
    fn excesses(&mut self, name: &'static str, axes: &[Axis], models: Axis) -> Vec<Excess> {
        let own = of_one_model(axes, models);
        let half = self.sizes.count(Sizes::of_one_model(models));
        let base = self.map(models, |index| (index < half).then_some(index));
        let indices = axes.iter().map(|&axis| {
            if axis == models {
                Index::Mapped(axis, base)
            } else {
                Index::Of(axis)
            }
        });
        let indices: Vec<Index> = indices.collect();
        let limits = [(1, i16::MAX), (-1, i16::MIN)];
        let excess = |(sign, limit): (i64, i16)| {
            let committed = self.commit(name, &own);
            Excess {
                sign,
                limit: limit.into(),
                committed,
                view: self.view(committed.tensor, &indices),
            }
        };
        limits.into_iter().map(excess).collect()
    }

    /// A view is zero unless the result is a limit.
    pub fn at_limit(
        &mut self,
        name: &'static str,
        axes: &[Axis],
        (view, limit): (usize, i64),
        result: Committed,
    ) {
        self.relations.monomials.push(Monomials {
            axes: axes.to_vec(),
            summed: 0,
            terms: vec![(1, [view, result.view].map(Factor::Virtual).to_vec())],
        });
        let product = Atom::Monomials(self.relations.monomials.len() - 1);
        let excess = times(-limit, Atom::Virtual(view));
        self.relations.equalities.push(Equality {
            name,
            axes: axes.to_vec(),
            linear: vec![one(product), excess],
        });
    }

    /// 1 on the base's half of an axis, and 0 on the update's.
    #[cfg(feature = "prove")]
    fn is_of_base(&self, models: Axis) -> Along {
        let all = 0..self.sizes.count(models);
        let half = all.len() / 2;
        Along::Axis(models, all.map(|index| (index < half) as i64).collect())
    }

    /// The numbers of the base's half of an axis.
    fn of_base(&self, numbers: &Along, models: Axis) -> Along {
        match numbers {
            Along::Axis(axis, numbers) if *axis == models => {
                let half = numbers.len() / 2;
                Along::Axis(Sizes::of_one_model(models), numbers[..half].to_vec())
            }
            other => other.clone(),
        }
    }

    /// A table: each row may be looked up any number of times. Each sample counts its own.
    pub fn offer(&mut self, name: &'static str, axes: &[Axis], columns: [LinearSum; 3], tag: Tag) {
        let axes = [axes, &[S]].concat();
        let counts = self.commit(name, &axes);
        let tag = vec![times(tag.number(), Atom::One)];
        self.look_up(name, &axes, Count::Offered(counts.view), columns, tag);
    }

    /// The table of ranges.
    pub fn offer_ranges(&mut self, value: usize, bits: usize) {
        let columns = [
            vec![one(Atom::Public(value))],
            vec![one(Atom::Public(bits))],
            vec![],
        ];
        self.offer("ranges", &[R], columns, Tag::Range);
    }

    /// Gives each tensor its place in its source. Returns for each source how many values it has, but for the other samples'.
    pub fn place(&mut self) -> [usize; 4] {
        let sizes = &self.sizes;
        let size = |axes: &[Axis]| -> u8 {
            let own = axes.iter().filter(|axis| **axis != S);
            own.map(|&axis| sizes.of(axis)).sum()
        };
        // Larger ones come first, so that each offset is a multiple of the size.
        let all: Vec<u8> = self.waiting.iter().map(|(_, axes)| size(axes)).collect();
        let mut ends = [0usize; 4];
        for number in from_largest(&all) {
            let (tensor, _) = &self.waiting[number];
            let tensor = &mut self.relations.tensors[*tensor];
            let end = &mut ends[tensor.source.0 as usize];
            tensor.offset = *end;
            *end += 1 << all[number];
        }
        let bits = ends.map(bits_of);
        for (tensor, axes) in &self.waiting {
            let tensor = &mut self.relations.tensors[*tensor];
            let mut shift = 0;
            for (place, &axis) in tensor.places.iter_mut().zip(axes) {
                let axis_bits = sizes.of(axis);
                if axis == S {
                    place.shift = bits[tensor.source.0 as usize];
                } else {
                    place.shift = shift;
                    shift += axis_bits;
                }
                place.bits = axis_bits;
            }
        }
        ends
    }
}
