//! The tensors of the action expert: their names, their shapes, and where each lies in the quantised weights.

use crate::model::spec::Dims;
use alloc::format;
use alloc::string::String;
use alloc::vec;
use alloc::vec::Vec;

/// Most fraction bits a tensor may have.
pub const MAX_WEIGHT_BITS: i16 = 24;

/// Name (LeRobot's) and shape of one trained tensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TensorSpec {
    /// LeRobot's name in the policy's state dict.
    pub name: String,
    /// `[rows, columns]` of a linear layer's weight, `[width]` of a bias or norm gain.
    pub shape: Vec<usize>,
}

impl TensorSpec {
    /// Number of values.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether it has no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Returns the tensors of the action expert in the canonical order, which quantised weights, digests and aggregation use.
pub fn expert_tensors(dims: &Dims) -> Vec<TensorSpec> {
    let layout = Layout::new(dims);
    let mut all = Vec::with_capacity(layout.tensors.len());
    let mut push = |name: String, shape: &[usize]| {
        let shape = shape.to_vec();
        all.push(TensorSpec { name, shape });
    };
    let (width, mlp) = (dims.expert_width as usize, dims.expert_mlp as usize);
    let action = dims.max_action_dim as usize;
    let (query, kv) = (dims.query_width(), dims.kv_width());
    for (name, rows, columns) in [
        ("action_in_proj", width, action),
        ("action_time_mlp_in", width, 2 * width),
        ("action_time_mlp_out", width, width),
    ] {
        push(format!("model.{name}.weight"), &[rows, columns]);
        push(format!("model.{name}.bias"), &[rows]);
    }
    for layer in 0..dims.layers as usize {
        let prefix = format!("model.vlm_with_expert.lm_expert.layers.{layer}");
        let kv_input = if dims.is_self_attention(layer) {
            width
        } else {
            kv
        };
        push(format!("{prefix}.input_layernorm.weight"), &[width]);
        push(format!("{prefix}.self_attn.q_proj.weight"), &[query, width]);
        push(format!("{prefix}.self_attn.k_proj.weight"), &[kv, kv_input]);
        push(format!("{prefix}.self_attn.v_proj.weight"), &[kv, kv_input]);
        push(format!("{prefix}.self_attn.o_proj.weight"), &[width, query]);
        push(
            format!("{prefix}.post_attention_layernorm.weight"),
            &[width],
        );
        push(format!("{prefix}.mlp.gate_proj.weight"), &[mlp, width]);
        push(format!("{prefix}.mlp.up_proj.weight"), &[mlp, width]);
        push(format!("{prefix}.mlp.down_proj.weight"), &[width, mlp]);
    }
    push(
        "model.vlm_with_expert.lm_expert.norm.weight".into(),
        &[width],
    );
    push("model.action_out_proj.weight".into(), &[action, width]);
    push("model.action_out_proj.bias".into(), &[action]);
    all
}

/// Where each tensor of [`expert_tensors`] lies. The guest needs no more than this, and computes no names.
#[derive(Clone, Debug)]
pub struct Layout {
    /// Where each tensor lies.
    pub tensors: Vec<Place>,
    /// Length of the whole buffer: one scale per tensor, then the values.
    pub len: usize,
}

/// Where a tensor lies in the buffer.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// Its first value, counted from the beginning of the buffer.
    pub start: usize,
    /// Its number of values.
    pub len: usize,
    /// Whether it is the matrix of a linear layer.
    pub is_matrix: bool,
}

/// Tensors before the first layer, and in each layer.
pub(crate) const HEAD_TENSORS: usize = 6;
pub(crate) const LAYER_TENSORS: usize = 9;

impl Layout {
    /// The places of the tensors of an expert with these dimensions.
    pub fn new(dims: &Dims) -> Self {
        let (width, mlp) = (dims.expert_width as usize, dims.expert_mlp as usize);
        let action = dims.max_action_dim as usize;
        let (query, kv) = (dims.query_width(), dims.kv_width());
        // (rows, columns) of each tensor; a bias or gain has no rows.
        let vector = (0, width);
        let mut shapes = vec![
            (width, action),
            vector,
            (width, 2 * width),
            vector,
            (width, width),
            vector,
        ];
        for layer in 0..dims.layers as usize {
            let kv_input = if dims.is_self_attention(layer) {
                width
            } else {
                kv
            };
            shapes.extend([
                vector,
                (query, width),
                (kv, kv_input),
                (kv, kv_input),
                (width, query),
            ]);
            shapes.extend([vector, (mlp, width), (mlp, width), (width, mlp)]);
        }
        shapes.extend([vector, (action, width), (0, action)]);
        let mut end = shapes.len();
        let tensors = shapes
            .into_iter()
            .map(|(rows, columns)| {
                let (start, len) = (end, rows.max(1) * columns);
                end += len;
                Place {
                    start,
                    len,
                    is_matrix: rows > 0,
                }
            })
            .collect();
        Self { tensors, len: end }
    }
}
