//! Where the weights of both models lie among the values that claims are about: each matrix is padded with zeros to powers of two.

use super::builder::{Builder, WEIGHTS};
use super::weighted_rows::combine;
use crate::field::goldilocks::P;
use crate::field::{Extension, Goldilocks};
use crate::party::Weighted;
use crate::relation::Committed;
use crate::relation::{Axis, AxisPlace, Part, Parts, Tensor};
use alloc::vec::Vec;
use zk0_circuits::model::layout::Layout;
use zk0_circuits::QuantisedWeights;

/// An index in a matrix, and the axes that it is spread over.
#[derive(Clone, Debug)]
pub struct Flat {
    /// The axes from the lowest, and the sizes of the dimensions that they stand for.
    axes: Vec<(Axis, usize)>,
    /// Indices that are used.
    pub used: usize,
}

impl Flat {
    /// An index on one axis.
    pub fn one(axis: Axis, used: usize) -> Self {
        let axes = alloc::vec![(axis, used)];
        Self { axes, used }
    }

    /// An index of `outer` times `inner`.
    pub fn two((inner, inner_size): (Axis, usize), (outer, outer_size): (Axis, usize)) -> Self {
        let axes = alloc::vec![(inner, inner_size), (outer, outer_size)];
        let used = inner_size * outer_size;
        Self { axes, used }
    }

    /// No index: a vector has no columns.
    pub fn none() -> Self {
        let axes = Vec::new();
        Self { axes, used: 1 }
    }

    /// The weight of each index, where the parts are those of its axes.
    fn weights(&self, parts: &[&Part]) -> Vec<Extension> {
        let tables: Vec<_> = parts.iter().map(|part| part.weights()).collect();
        let weight = |mut index: usize| {
            let digits = self.axes.iter().zip(&tables).map(|((_, size), weights)| {
                let weight = weights[index % size];
                index /= size;
                weight
            });
            digits.fold(Extension::ONE, |product, weight| product * weight)
        };
        (0..self.used).map(weight).collect()
    }

    /// What `index` adds to the number of a value.
    fn number(&self, mut index: usize, places: &[AxisPlace]) -> usize {
        let mut number = 0;
        for ((_, size), place) in self.axes.iter().zip(places) {
            number += (index % size) << place.shift;
            index /= size;
        }
        number
    }
}

/// A matrix of the weights: number among the expert's tensors, length of a row, and the first column that is used.
#[derive(Clone, Copy, Debug)]
pub struct Matrix {
    /// 0 for the base, 1 for the update.
    pub model: usize,
    /// Its number among the expert's tensors.
    pub tensor: usize,
    /// Columns of the matrix.
    pub stride: usize,
    /// The first column that is used.
    pub first: usize,
}

/// Matrices of one kind, padded: columns first, then rows, then the last axis.
#[derive(Clone, Debug)]
pub struct Matrices {
    /// The tensor.
    pub tensor: usize,
    /// Its columns.
    pub columns: Flat,
    /// Its rows.
    pub rows: Flat,
    /// One matrix for each index on the last axis; zeros where there is none.
    pub all: Vec<Option<Matrix>>,
}

/// A claim about matrices, with the weight of each value as a product: of its row's, its column's, and its matrix'.
pub struct Claimed {
    rows: Vec<[i32; 4]>,
    columns: Vec<Extension>,
    matrices: Vec<Extension>,
}

/// The largest value that stands for a positive number where halves are taken. Up to here the upper half is below 2^31, and from here on the
/// number less the modulus is at least −2^63.
const POSITIVE: u64 = (1 << 63) - (1 << 32);

/// Signed halves of both coefficients, of 32 bits each.
fn halves(element: Extension) -> [i32; 4] {
    let [a, b] = element.0.map(|coefficient| {
        let value = coefficient.value();
        let signed = if value > POSITIVE {
            value.wrapping_sub(P) as i64
        } else {
            value as i64
        };
        let low = signed as i32;
        [low, ((signed - low as i64) >> 32) as i32]
    });
    [a[0], a[1], b[0], b[1]]
}

/// The element whose halves these are sums of.
fn whole(sums: [i64; 4]) -> Extension {
    let element = |low: i64, high: i64| {
        Goldilocks::from_i64(low) + Goldilocks::from_i64(high) * Goldilocks::from_i64(1 << 32)
    };
    Extension([element(sums[0], sums[1]), element(sums[2], sums[3])])
}

impl Matrices {
    /// What a claim about this tensor states of its values. `None` if the claim is about other values than the tensor's.
    pub fn claimed(&self, tensor: &Tensor, parts: &Parts, about: &Weighted) -> Option<Claimed> {
        let places = tensor.places.iter().zip(&about.parts);
        let fits = about.parts.len() == tensor.places.len()
            && about.offset == tensor.offset
            && places.into_iter().all(|(place, &(shift, id))| {
                place.shift == shift && place.bits as usize == parts.get(id).bits()
            });
        if !fits {
            return None;
        }
        let own: Vec<&Part> = about.parts.iter().map(|(_, id)| parts.get(*id)).collect();
        let (columns, rest) = own.split_at(self.columns.axes.len());
        let (rows, last) = rest.split_at(self.rows.axes.len());
        let rows = self.rows.weights(rows).into_iter().map(halves);
        Some(Claimed {
            rows: rows.collect(),
            columns: self.columns.weights(columns),
            matrices: last[0].weights().into_owned(),
        })
    }

    /// The numbers of the matrices that are made of a tensor of a model.
    pub fn made_of(&self, model: usize, tensor: usize) -> impl Iterator<Item = usize> + '_ {
        let all = self.all.iter().enumerate();
        all.filter_map(move |(index, matrix)| {
            let matrix = matrix.as_ref()?;
            (matrix.model == model && matrix.tensor == tensor).then_some(index)
        })
    }

    /// The sum of the values of the matrix with this number times what a claim weighs them with. `values` are those of its whole tensor.
    pub fn sum(&self, number: usize, claimed: &Claimed, values: &[i16]) -> Extension {
        let Some(matrix) = self.all[number] else {
            return Extension::ZERO;
        };
        let sums = combine(values, matrix.stride, &claimed.rows);
        let columns = claimed.columns.iter().enumerate();
        let sum: Extension = columns
            .map(|(column, &weight)| {
                weight * whole(sums.each_ref().map(|half| half[matrix.first + column]))
            })
            .sum();
        claimed.matrices[number] * sum
    }

    /// Adds a tensor of weights.
    pub fn add(
        builder: &mut Builder,
        name: &'static str,
        (columns, rows): (Flat, Flat),
        last: Axis,
        all: Vec<Option<Matrix>>,
    ) -> (Self, Committed) {
        let axes = columns.axes.iter().chain(&rows.axes).map(|(axis, _)| *axis);
        let axes: Vec<Axis> = axes.chain([last]).collect();
        let committed = builder.tensor(name, WEIGHTS, &axes);
        let own = Self {
            tensor: committed.tensor,
            columns,
            rows,
            all,
        };
        (own, committed)
    }

    /// Calls `f` with the number and the value of each weight.
    pub fn each(
        &self,
        tensor: &Tensor,
        layout: &Layout,
        weights: [&QuantisedWeights; 2],
        mut f: impl FnMut(usize, i16),
    ) {
        let (column_places, rest) = tensor.places.split_at(self.columns.axes.len());
        let (row_places, last) = rest.split_at(self.rows.axes.len());
        for (index, matrix) in self.all.iter().enumerate() {
            let Some(matrix) = matrix else { continue };
            let (values, _) = weights[matrix.model].tensor(layout, matrix.tensor);
            let start = tensor.offset + (index << last[0].shift);
            for row in 0..self.rows.used {
                let start = start + self.rows.number(row, row_places);
                let values = &values[row * matrix.stride + matrix.first..][..self.columns.used];
                for (column, &value) in values.iter().enumerate() {
                    f(start + self.columns.number(column, column_places), value);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_element_is_the_whole_of_its_halves() {
        let edges = [
            0,
            1,
            1 << 31,
            1 << 32,
            POSITIVE,
            P / 2,
            1 << 63,
            P - (1 << 31),
            P - 1,
        ];
        let around = edges
            .iter()
            .flat_map(|&edge| [edge.max(1) - 1, edge, (edge + 1) % P]);
        let values: Vec<u64> = around.collect();
        for &a in &values {
            for &b in &values {
                let words = [a, b];
                let coefficients = Goldilocks::of_words(&words).unwrap();
                let element = Extension::of_coefficients(coefficients)[0];
                assert_eq!(whole(halves(element).map(i64::from)), element, "{a} {b}");
            }
        }
    }
}
