//! Linear layers: sums of products with the weights, shifted to the scale of their outputs
//! ([`zk0_circuits::model::linear`]).

use crate::expert::builder::{one, power_of_two, times, Builder, Saturating};
use crate::expert::publics::number;
use crate::expert::statement::Statement;
use crate::expert::weights::{Flat, Matrices, Matrix};
use crate::relation::along::Along;
use crate::relation::Committed;
use crate::relation::{Atom, Axis, Count, Product};
use alloc::vec;
use alloc::vec::Vec;
#[cfg(feature = "prove")]
use rayon::prelude::*;
use zk0_circuits::model::layout::Layout;
use zk0_circuits::model::linear::{Linear, Output, HALF, SUM_BITS};

/// One of the evaluation's linear layers, and one of its matrices.
#[derive(Clone, Copy, Debug)]
pub struct Which {
    /// 0 for the base, 1 for the update.
    pub model: usize,
    /// Number of the linear layer.
    pub linear: usize,
    /// Number of the matrix in it.
    pub output: usize,
}

/// What the layers are made of.
pub struct LayerSource<'a> {
    /// The statement.
    pub statement: &'a Statement,
    /// The evaluation's linear layers.
    pub linears: &'a [Linear],
    /// Where the weights lie.
    pub layout: &'a Layout,
}

impl LayerSource<'_> {
    /// The matrix, and the fraction bits of its layer's input.
    fn output(&self, which: Which) -> (Output, u8) {
        let linear = &self.linears[which.linear];
        (linear.outputs[which.output], linear.bits)
    }

    /// Columns of a matrix, as it lies.
    fn stride(&self, which: Which) -> usize {
        self.linears[which.linear].columns
    }

    /// How far the products with a matrix are shifted.
    fn shift(&self, which: Which) -> i64 {
        let (output, bits) = self.output(which);
        let own = self.statement.scales[which.model][output.matrix];
        output.shift(bits, own) as i64
    }

    fn bias_shift(&self, which: Which) -> i64 {
        let (output, _) = self.output(which);
        let own = output
            .bias
            .map(|bias| self.statement.scales[which.model][bias]);
        own.map_or(0, |own| output.bias_shift(own) as i64)
    }
}

/// A product of inputs with weights.
pub struct WeightedInput<'a> {
    /// The inputs' view.
    pub input: usize,
    /// Columns of the weights: the axes that are summed over.
    pub columns: Flat,
    /// The first column that is used.
    pub first: usize,
    /// Axes that only the inputs have.
    pub left: &'a [Axis],
    /// Axes that are summed over.
    pub summed: &'a [Axis],
    /// Whether the inputs have the last axis of the weights.
    pub shared: bool,
}

/// A linear layer of several models or layers.
pub struct Layer<'a> {
    /// Names it.
    pub name: &'static str,
    /// Axes of the outputs, samples last.
    pub axes: &'a [Axis],
    /// Which outputs count.
    pub count: Count,
    /// Rows of the weights.
    pub rows: Flat,
    /// Axes of rows.
    pub row_axes: &'a [Axis],
    /// The last axis of the weights, and the matrix for each index on it.
    pub last: (Axis, Vec<Option<Which>>),
    /// Whether the outputs are looked up in a table of gates, which has int16 alone, wherever they count.
    pub is_gate: bool,
    /// What is multiplied: products of this kind are added.
    pub factors: Vec<WeightedInput<'a>>,
}

impl Layer<'_> {
    /// Adds the layer. Returns its outputs, and the weights.
    pub fn add(
        self,
        builder: &mut Builder,
        source: &LayerSource<'_>,
    ) -> (Committed, Vec<Matrices>) {
        let (last, which) = &self.last;
        let along = |f: &dyn Fn(Which) -> i64| {
            let numbers = which.iter().map(|which| which.map_or(0, f));
            Along::Axis(*last, numbers.collect())
        };
        let power = along(&|which| power_of_two(source.shift(which)));
        let mut value = vec![times(HALF, Atom::One)];
        let mut weights = vec![];
        for factor in &self.factors {
            let matrix = |which: &Option<Which>| {
                which.map(|which| Matrix {
                    model: which.model,
                    tensor: source.output(which).0.matrix,
                    stride: source.stride(which),
                    first: factor.first,
                })
            };
            let all = which.iter().map(matrix).collect();
            let shape = (factor.columns.clone(), self.rows.clone());
            let (matrices, committed) = Matrices::add(builder, self.name, shape, *last, all);
            weights.push(matrices);
            let own = if factor.shared {
                (self.row_axes.to_vec(), vec![*last])
            } else {
                ([self.row_axes, &[*last]].concat(), vec![])
            };
            builder.relations.products.push(Product {
                left: factor.input,
                right: committed.view,
                left_axes: factor.left.to_vec(),
                right_axes: own.0,
                shared: own.1,
                summed: factor.summed.to_vec(),
            });
            let product = Atom::Product(builder.relations.products.len() - 1);
            value.push(builder.scaled(&power, 1, product));
        }
        let bias = |which: &Option<Which>| {
            let which = (*which)?;
            let bias = source.output(which).0.bias?;
            Some(Matrix {
                model: which.model,
                tensor: bias,
                stride: 1,
                first: 0,
            })
        };
        let biases: Vec<_> = which.iter().map(bias).collect();
        if biases.iter().any(Option::is_some) {
            let shape = (Flat::none(), self.rows.clone());
            let (matrices, committed) = Matrices::add(builder, self.name, shape, *last, biases);
            weights.push(matrices);
            let power = along(&|which| power_of_two(source.bias_shift(which)));
            value.push(builder.scaled(&power, 1, committed.atom()));
        }
        let shift = Along::Everywhere(SUM_BITS as i64);
        // Sums are below 2^63.
        let bits = Along::Everywhere(63 - SUM_BITS as i64);
        let saturating = Saturating {
            models: *last,
            bits,
        };
        let out = builder.commit(self.name, self.axes);
        let within = Along::Everywhere(16);
        let shifts = (&shift, (!self.is_gate).then_some(&within));
        builder.floor_into(
            out,
            self.axes,
            self.count,
            (value, None),
            shifts,
            Some(saturating),
        );
        (out, weights)
    }
}

/// The residual stream: outputs of a layer plus what there was, at the scale of the outputs
/// ([`zk0_circuits::model::arithmetic::fixed::Rescale`]).
pub fn add_residual(
    builder: &mut Builder,
    result: Committed,
    axes: &[Axis],
    sums: Committed,
    residual: usize,
    (from, to): (&Along, &Along),
) {
    let (Along::Axis(axis, from), Along::Axis(_, to)) = (from, to) else {
        unreachable!("scales differ along an axis");
    };
    let differences: Vec<i64> = to.iter().zip(from).map(|(to, from)| to - from).collect();
    let differences = Along::Axis(*axis, differences);
    let left = differences.map(|bits| power_of_two(bits.max(0)));
    let right = differences.map(|bits| (-bits).max(0));
    let half = right.map(|bits| power_of_two(bits) >> 1);
    let value = vec![
        builder.scaled(&left, 1, Atom::Virtual(residual)),
        builder.scaled(&half, 1, Atom::One),
    ];
    let count = Count::Masked(number::TOKENS);
    let within = Along::Everywhere(16);
    let saturating = Saturating {
        models: *axis,
        // The sum of an int16 and another one, which is shifted to the left
        bits: differences.map(|bits| 17 + bits.max(0)),
    };
    let shifts = (&right, Some(&within));
    builder.floor_into(
        result,
        axes,
        count,
        (value, Some(sums)),
        shifts,
        Some(saturating),
    );
}

/// The values of a gate times the logistic function, from tables.
pub fn gate(
    builder: &mut Builder,
    name: &'static str,
    axes: &[Axis],
    gate: Committed,
    bits: &Along,
) -> Committed {
    let result = builder.commit(name, axes);
    #[cfg(feature = "prove")]
    {
        let (axes, bits) = (axes.to_vec(), bits.clone());
        builder.step(move |filling| {
            let mut values = filling.linear(&vec![one(gate.atom())], &axes);
            let bits = filling.along(&bits, &axes);
            let pairs = values.par_iter_mut().zip(bits);
            pairs.for_each(|(value, bits)| *value = gated(*value, bits as u8));
            filling.set(result, &axes, &values);
        });
    }
    let tag = bits.map(|bits| crate::expert::builder::Tag::Gate(bits as u8).number());
    let tag = vec![builder.scaled(&tag, 1, Atom::One)];
    let columns = [vec![one(gate.atom())], vec![one(result.atom())], vec![]];
    builder.look_up(name, axes, Count::Masked(number::TOKENS), columns, tag);
    result
}

/// `value · logistic(value)`, where the value has `bits` fraction bits and the logistic function 15.
pub fn gated(value: i64, bits: u8) -> i64 {
    use zk0_circuits::model::arithmetic::tables::{sigmoid, LOGIT_BITS};
    value * sigmoid(value << (LOGIT_BITS - bits as u32))
}
