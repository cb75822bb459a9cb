//! Where the weights of both models lie among the values that claims are about: each matrix is padded with zeros to powers of two.

use super::builder::{Builder, WEIGHTS};
use crate::relation::Committed;
use crate::relation::{Axis, Place, Tensor};
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

    /// What `index` adds to the number of a value.
    fn number(&self, mut index: usize, places: &[Place]) -> usize {
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

impl Matrices {
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
