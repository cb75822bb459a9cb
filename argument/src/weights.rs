//! The weights of the indices of some axes, and values that are known for some weights.

use crate::field::Extension;
use crate::relation::{Axis, Part, PartId, Parts, Relations};
use alloc::vec;
use alloc::vec::Vec;
use core::ops::{Deref, DerefMut};

/// Most axes that a claim is about.
const MOST: usize = 8;

/// The weights of the indices of some axes. They are copied often, so that they lie in one piece and not in a vector.
#[derive(Clone, Copy, Debug, Default)]
pub struct PointWeights {
    count: usize,
    all: [(Axis, PartId); MOST],
}

impl PointWeights {
    /// Adds an axis.
    pub fn push(&mut self, axis: Axis, part: PartId) {
        self.all[self.count] = (axis, part);
        self.count += 1;
    }

    /// The part of an axis. The statement states that there is one.
    pub fn part(&self, axis: Axis) -> PartId {
        let found = self.iter().find(|(of, _)| *of == axis);
        match found {
            Some((_, part)) => *part,
            None => unreachable!("relations are validated"),
        }
    }

    /// The weights of these axes.
    pub fn of<'a>(&self, axes: impl IntoIterator<Item = &'a Axis>) -> Self {
        let mut own = Self::default();
        for &axis in axes {
            own.push(axis, self.part(axis));
        }
        own
    }
}

impl Deref for PointWeights {
    type Target = [(Axis, PartId)];

    fn deref(&self) -> &Self::Target {
        &self.all[..self.count]
    }
}

impl DerefMut for PointWeights {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut self.all[..self.count]
    }
}

impl PartialEq for PointWeights {
    fn eq(&self, other: &Self) -> bool {
        self.count == other.count && self.iter().zip(other.iter()).all(|(a, b)| a == b)
    }
}

impl Eq for PointWeights {}

/// A point of a sumcheck, whose first coordinates are those of a smaller tensor's axes.
pub struct Point<'a> {
    coordinates: &'a [Extension],
    /// The weights of instances.
    instances: PartId,
    /// For each first coordinate, the ends of the parts that begin there.
    known: Vec<Vec<(usize, PartId)>>,
}

impl<'a> Point<'a> {
    /// A point within an instance, and the weights of instances.
    pub fn new(coordinates: &'a [Extension], instances: PartId) -> Self {
        Self {
            coordinates,
            instances,
            known: vec![vec![]; coordinates.len() + 1],
        }
    }

    /// The parts of the axes, which lie one after the other from the first coordinate on.
    pub fn weights(
        &mut self,
        relations: &Relations,
        parts: &mut Parts,
        axes: &[Axis],
    ) -> PointWeights {
        let mut start = 0;
        let mut weights = PointWeights::default();
        for &axis in axes {
            if relations.are_instances(axis) {
                weights.push(axis, self.instances);
                continue;
            }
            let end = start + relations.bits(axis);
            let mut known = self.known[start].iter();
            let id = match known.find(|(of, _)| *of == end) {
                Some((_, id)) => *id,
                None => {
                    let id = parts.add(Part::Point(self.coordinates[start..end].to_vec()));
                    self.known[start].push((end, id));
                    id
                }
            };
            weights.push(axis, id);
            start = end;
        }
        weights
    }
}

/// Values of tensors, each with some weights. There are few weights for each tensor.
pub struct Known<V>(Vec<Vec<(PointWeights, V)>>);

impl<V: Clone> Known<V> {
    /// For so many tensors.
    pub fn new(count: usize) -> Self {
        Self(vec![vec![]; count])
    }

    /// The value of a tensor.
    pub fn get(&self, number: usize, weights: &PointWeights) -> Option<&V> {
        let known = self.0[number].iter().find(|(of, _)| of == weights);
        known.map(|(_, value)| value)
    }

    /// Keeps a value.
    pub fn insert(&mut self, number: usize, weights: PointWeights, value: V) {
        self.0[number].push((weights, value));
    }
}
