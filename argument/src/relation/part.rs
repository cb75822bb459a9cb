//! Weights of the indices of one axis, and the place where an argument keeps all of them.
//!
//! A claim about a tensor is `Σ_b w(b)·T(b) = v`, where `w` is a product with one factor for each axis: its [`Part`]. Many claims
//! share parts, so a part is kept once and named by a number, and what is computed from it is kept too.

use crate::field::{Extension, Goldilocks};
use crate::multilinear::{eq, eq_bits, eq_table};
use alloc::borrow::Cow;
use alloc::collections::BTreeMap;
use alloc::vec;
use alloc::vec::Vec;

/// What the indices of an axis of 2^bits are multiplied with.
#[derive(Clone, Debug)]
pub enum Part {
    /// `eq(point, index)`.
    Point(Vec<Extension>),
    /// A weight for each index.
    Vector(Vec<Extension>),
    /// 1, on an axis with so many bits.
    Ones(u32),
}

impl Part {
    /// Binary logarithm of the number of indices.
    pub fn bits(&self) -> usize {
        match self {
            Self::Point(point) => point.len(),
            Self::Vector(weights) => weights.len().trailing_zeros() as usize,
            Self::Ones(bits) => *bits as usize,
        }
    }

    /// The multilinear polynomial of the weights, at `point`.
    pub fn at(&self, point: &[Extension]) -> Extension {
        match self {
            Self::Point(own) => eq(own, point),
            Self::Vector(weights) => {
                let table = eq_table(point);
                let terms = table.iter().zip(weights);
                terms.map(|(&a, &b)| a * b).sum()
            }
            Self::Ones(_) => Extension::ONE,
        }
    }

    /// The weight of one index.
    pub fn weight(&self, index: usize) -> Extension {
        match self {
            Self::Point(point) => eq_bits(index, point),
            Self::Vector(weights) => weights.get(index).copied().unwrap_or_default(),
            Self::Ones(_) => Extension::ONE,
        }
    }

    /// All weights.
    pub fn weights(&self) -> Cow<'_, [Extension]> {
        match self {
            Self::Point(point) => eq_table(point).into(),
            Self::Vector(weights) => weights.into(),
            Self::Ones(bits) => vec![Extension::ONE; 1 << bits].into(),
        }
    }

    /// The sum of all weights.
    fn total(&self) -> Extension {
        match self {
            Self::Point(_) => Extension::ONE,
            Self::Vector(weights) => weights.iter().copied().sum(),
            Self::Ones(bits) => Goldilocks::from_u32(1 << bits).into(),
        }
    }
}

/// The number of a part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct PartId(u32);

impl PartId {
    /// The part with this number.
    pub fn of_number(number: u32) -> Self {
        Self(number)
    }

    /// The number, counted from 0.
    pub fn number(self) -> usize {
        self.0 as usize
    }
}

/// What follows from a part, for [`Parts`] to keep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Derived {
    /// All weights, written out.
    Table,
    /// Multiplied with a vector of coefficients.
    Scaled(usize),
    /// Moved to another axis.
    Mapped(usize),
    /// Multiplied with another part.
    Times(PartId),
}

/// All parts of an argument.
#[derive(Default)]
pub struct Parts {
    parts: Vec<Part>,
    /// What was derived from each part.
    derived: Vec<Vec<(Derived, PartId)>>,
    ones: BTreeMap<u32, PartId>,
}

impl Parts {
    /// Keeps a part.
    pub fn add(&mut self, part: Part) -> PartId {
        self.parts.push(part);
        self.derived.push(Vec::new());
        PartId(self.parts.len() as u32 - 1)
    }

    /// The number of parts.
    pub fn count(&self) -> usize {
        self.parts.len()
    }

    /// The part with this number.
    pub fn get(&self, id: PartId) -> &Part {
        &self.parts[id.0 as usize]
    }

    /// The sum of a part's weights.
    pub fn total(&self, id: PartId) -> Extension {
        self.get(id).total()
    }

    /// The part with these weights, written out: a table of eq is computed once.
    pub fn table(&mut self, id: PartId) -> PartId {
        match self.get(id) {
            Part::Vector(_) => id,
            _ => self.derive(id, Derived::Table, |parts| {
                parts.get(id).weights().into_owned()
            }),
        }
    }

    /// The part whose weights are those of `id` times those of a public vector, which is number `number` of the statement.
    pub fn scaled(&mut self, id: PartId, number: usize, factors: &[Goldilocks]) -> PartId {
        self.derive(id, Derived::Scaled(number), |parts| {
            let table = parts.table(id);
            let weights = parts.get(table).weights();
            let scaled = weights.iter().zip(factors);
            scaled.map(|(w, &factor)| w.scale(factor)).collect()
        })
    }

    /// 1 for each index of an axis of 2^`bits`.
    pub fn ones(&mut self, bits: u32) -> PartId {
        if let Some(&known) = self.ones.get(&bits) {
            return known;
        }
        let id = self.add(Part::Ones(bits));
        self.ones.insert(bits, id);
        id
    }

    /// The part of an axis with `bits` bits. Index `i` of the part `id` adds its weight to index `map[i]`, if there is one. The map comes
    /// with its number in the statement.
    pub fn mapped(
        &mut self,
        id: PartId,
        (number, map): (usize, &[Option<u16>]),
        bits: usize,
    ) -> PartId {
        self.derive(id, Derived::Mapped(number), |parts| {
            let table = parts.table(id);
            let mut weights = vec![Extension::ZERO; 1 << bits];
            for (&weight, place) in parts.get(table).weights().iter().zip(map) {
                if let Some(place) = place {
                    weights[*place as usize] += weight;
                }
            }
            weights
        })
    }

    /// The part whose weights are products of those of two parts of one axis.
    pub fn times(&mut self, id: PartId, other: PartId) -> PartId {
        self.derive(id, Derived::Times(other), |parts| {
            let tables = [parts.table(id), parts.table(other)];
            let [own, others] = tables.map(|table| parts.get(table).weights());
            own.iter().zip(&others[..]).map(|(&a, &b)| a * b).collect()
        })
    }

    fn derive(
        &mut self,
        id: PartId,
        how: Derived,
        make: impl FnOnce(&mut Self) -> Vec<Extension>,
    ) -> PartId {
        let mut known = self.derived[id.0 as usize].iter();
        if let Some((_, known)) = known.find(|(own, _)| *own == how) {
            return *known;
        }
        let weights = make(self);
        let new = self.add(Part::Vector(weights));
        self.derived[id.0 as usize].push((how, new));
        new
    }
}
