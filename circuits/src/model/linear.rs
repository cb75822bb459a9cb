//! The linear layers in the order of evaluation: which matrices share an input, and at which scales.
//!
//! The sum of an output is kept with 16 fraction bits more than the output itself:
//!
//! `sum = Σ x·w · 2^shift + bias · 2^… + 2^15`, `output = sum >> 16` (rounded half up),
//!
//! where `shift` brings the products to the scale of the sum. The sum must fit int32, which is the same as the output
//! fitting int16. The fraction bits of a tensor are limited so that `shift` is not negative. Sums are therefore exact.

use crate::model::layout::{HEAD_TENSORS, LAYER_TENSORS, MAX_WEIGHT_BITS};
use crate::model::site::Site;
use crate::model::spec::EvalSpec;
use alloc::vec;
use alloc::vec::Vec;

/// Fraction bits of a sum beyond those of its output.
pub const SUM_BITS: u32 = 16;
/// Added to a sum, it rounds the sum's high half to nearest.
pub const HALF: i64 = 1 << (SUM_BITS - 1);
/// Largest shift: products over 2^14 columns stay below 2^44, shifted below 2^62.
const MAX_SHIFT: i32 = 18;

/// The output of a sum.
#[inline(always)]
pub fn output(sum: i32) -> i64 {
    (sum >> SUM_BITS) as i64
}

/// Matrices that multiply the same input.
#[derive(Clone, Debug)]
pub struct Linear {
    /// Values of an input row.
    pub columns: usize,
    /// Fraction bits of the input.
    pub bits: u8,
    /// The matrices.
    pub outputs: Vec<Output>,
}

/// One matrix of a [`Linear`].
#[derive(Clone, Copy, Debug)]
pub struct Output {
    /// Where its outputs are narrowed.
    pub site: Site,
    /// The matrix, as index into [`crate::model::layout::expert_tensors`].
    pub matrix: usize,
    /// Rows used: outputs per input row.
    pub rows: usize,
    /// The bias, likewise.
    pub bias: Option<usize>,
    /// Fraction bits of the outputs.
    pub bits: u8,
}

impl Linear {
    /// Rows of all matrices: outputs per input row.
    pub fn rows(&self) -> usize {
        self.outputs.iter().map(|output| output.rows).sum()
    }
}

impl Output {
    /// Left shift of a product with a matrix of `matrix_bits` fraction bits and an input of `input_bits`.
    pub fn shift(&self, input_bits: u8, matrix_bits: i16) -> u32 {
        let shift = SUM_BITS as i32 + self.bits as i32 - input_bits as i32 - matrix_bits as i32;
        shift.clamp(0, MAX_SHIFT) as u32 // `bit_limits` keeps it within these bounds
    }

    /// Left shift of a bias with `bias_bits` fraction bits.
    pub fn bias_shift(&self, bias_bits: i16) -> u32 {
        (SUM_BITS as i32 + self.bits as i32 - bias_bits as i32).max(0) as u32
    }
}

/// Place of a layer's linears, from [`first_of_layer`] on.
pub mod place {
    /// Queries; in self-attention also keys and values.
    pub const QUERY: usize = 0;
    /// Keys, in cross-attention.
    pub const KEY: usize = 1;
    /// Values, in cross-attention.
    pub const VALUE: usize = 2;
    /// `o_proj`.
    pub const OUT: usize = 3;
    /// Gate and up.
    pub const GATE_UP: usize = 4;
    /// `down_proj`.
    pub const DOWN: usize = 5;
    /// Linears per layer; in self-attention, `KEY` and `VALUE` have no outputs.
    pub const COUNT: usize = 6;
}

/// `action_in_proj`, `action_time_mlp_in`, `action_time_mlp_out`: linears 0, 1, 2.
const BEFORE_LAYERS: usize = 3;

/// Index of the first linear of `layer`; for the number of layers, that of `action_out_proj`.
pub fn first_of_layer(layer: usize) -> usize {
    BEFORE_LAYERS + layer * place::COUNT
}

/// All linear layers of a valid specification.
pub fn linears(spec: &EvalSpec) -> Vec<Linear> {
    let dims = &spec.dims;
    let (width, mlp) = (dims.expert_width as usize, dims.expert_mlp as usize);
    let (query, kv) = (dims.query_width(), dims.kv_width());
    let head = |site, matrix, columns, bits, out| Linear {
        columns,
        bits,
        outputs: vec![Output {
            site,
            matrix,
            rows: width,
            bias: Some(matrix + 1),
            bits: out,
        }],
    };
    let action = dims.max_action_dim as usize;
    let mut all = vec![
        head(Site::ActionIn, 0, action, spec.action, spec.embedding),
        head(
            Site::TimeMlpIn,
            2,
            2 * width,
            spec.embedding,
            spec.time_hidden,
        ),
        head(
            Site::TimeMlpOut,
            4,
            width,
            spec.time_activation,
            spec.hidden,
        ),
    ];
    for (layer, scales) in spec.layers.iter().enumerate() {
        let first = HEAD_TENSORS + layer * LAYER_TENSORS;
        let output = |site, index, rows, bits| Output {
            site,
            matrix: first + index,
            rows,
            bias: None,
            bits,
        };
        let linear = |columns, bits, outputs| Linear {
            columns,
            bits,
            outputs,
        };
        let queries = output(Site::Query(layer), 1, query, scales.query);
        let keys = output(Site::Key(layer), 2, kv, scales.key);
        let values = output(Site::Value(layer), 3, kv, scales.value);
        if dims.is_self_attention(layer) {
            let nothing = || linear(0, 0, vec![]);
            all.push(linear(width, scales.normed, vec![queries, keys, values]));
            all.extend([nothing(), nothing()]);
        } else {
            all.push(linear(width, scales.normed, vec![queries]));
            all.push(linear(kv, scales.cache_key, vec![keys]));
            all.push(linear(kv, scales.cache_value, vec![values]));
        }
        let out = output(Site::AttentionOut(layer), 4, width, scales.attended);
        all.push(linear(query, scales.value, vec![out]));
        let gate = output(Site::Gate(layer), 6, mlp, scales.gate);
        let up = output(Site::Up(layer), 7, mlp, scales.up);
        all.push(linear(width, scales.mlp_normed, vec![gate, up]));
        let down = output(Site::Down(layer), 8, width, scales.hidden);
        all.push(linear(mlp, scales.gated, vec![down]));
    }
    let last = HEAD_TENSORS + spec.layers.len() * LAYER_TENSORS;
    all.push(Linear {
        columns: width,
        bits: spec.final_normed,
        // Only the rows of the real action dimensions.
        outputs: vec![Output {
            site: Site::Velocity,
            matrix: last + 1,
            rows: dims.action_dim as usize,
            bias: Some(last + 2),
            bits: spec.action,
        }],
    });
    all
}

/// Returns the least and most fraction bits of each tensor with which every shift is within its bounds.
pub fn bit_limits(spec: &EvalSpec, tensors: usize) -> Vec<(i16, i16)> {
    let mut limits = vec![(0, MAX_WEIGHT_BITS); tensors];
    for linear in linears(spec) {
        for output in &linear.outputs {
            let most = (SUM_BITS as i32 + output.bits as i32 - linear.bits as i32) as i16;
            let least = most - MAX_SHIFT as i16;
            limits[output.matrix] = (least.max(0), most.min(MAX_WEIGHT_BITS));
            if let Some(bias) = output.bias {
                let most = (SUM_BITS as i16 + output.bits as i16).min(MAX_WEIGHT_BITS);
                limits[bias] = (0, most);
            }
        }
    }
    limits
}
