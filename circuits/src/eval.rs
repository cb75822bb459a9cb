//! Fixed-point evaluation of the action expert: the flow-matching loss of one sample, the same bits on every machine
//! and in the guest.
//!
//! Follows SmolVLA as LeRobot computes it (arXiv 2506.01844; lerobot 0.4.4). Activations and weights are int16, sums
//! int64. A linear layer adds bias and residual at the scale of its sums, so that each output is rounded once. Every
//! narrowing to int16 is a shift (half up) or a division (to nearest) whose result must fit, or the evaluation fails
//! and names the site.

use crate::{
    challenge::Draw,
    fixed::{align, integer_sqrt, round_divide, round_shift, Narrow, Rescale},
    products::{dot, products, Rows},
    sample::Sample,
    spec::{EvalSpec, LayerScales, SpecError},
    tables,
    weights::{Layout, QuantisedWeights, HEAD_TENSORS, LAYER_TENSORS},
};
use alloc::{vec, vec::Vec};
use core::fmt;

/// A place in the evaluation where values are narrowed to int16.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Site {
    /// `x_t`.
    NoisedAction,
    /// `action_in_proj`.
    ActionIn,
    /// `action_time_mlp_in`.
    TimeMlpIn,
    /// SiLU of the time MLP.
    TimeMlpSilu,
    /// `action_time_mlp_out`.
    TimeMlpOut,
    /// `input_layernorm` of a layer.
    InputNorm(usize),
    /// `q_proj` of a layer.
    Query(usize),
    /// `k_proj` of a layer.
    Key(usize),
    /// `v_proj` of a layer.
    Value(usize),
    /// RoPE of a layer's queries.
    RotatedQuery(usize),
    /// RoPE of a layer's keys.
    RotatedKey(usize),
    /// Attention output of a layer.
    Attention(usize),
    /// Residual stream after `o_proj` of a layer.
    Attended(usize),
    /// `post_attention_layernorm` of a layer.
    MlpNorm(usize),
    /// `gate_proj` of a layer.
    Gate(usize),
    /// `up_proj` of a layer.
    Up(usize),
    /// `silu(gate) · up` of a layer.
    Gated(usize),
    /// Residual stream after `down_proj` of a layer.
    MlpOut(usize),
    /// Final norm.
    FinalNorm,
    /// `action_out_proj`: the velocity.
    Velocity,
}

impl fmt::Display for Site {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NoisedAction => write!(f, "noised action x_t"),
            Self::ActionIn => write!(f, "action_in_proj"),
            Self::TimeMlpIn => write!(f, "action_time_mlp_in"),
            Self::TimeMlpSilu => write!(f, "SiLU of the time MLP"),
            Self::TimeMlpOut => write!(f, "action_time_mlp_out"),
            Self::InputNorm(layer) => write!(f, "layer {layer} input_layernorm"),
            Self::Query(layer) => write!(f, "layer {layer} q_proj"),
            Self::Key(layer) => write!(f, "layer {layer} k_proj"),
            Self::Value(layer) => write!(f, "layer {layer} v_proj"),
            Self::RotatedQuery(layer) => write!(f, "layer {layer} rotated query"),
            Self::RotatedKey(layer) => write!(f, "layer {layer} rotated key"),
            Self::Attention(layer) => write!(f, "layer {layer} attention output"),
            Self::Attended(layer) => write!(f, "layer {layer} residual after o_proj"),
            Self::MlpNorm(layer) => write!(f, "layer {layer} post_attention_layernorm"),
            Self::Gate(layer) => write!(f, "layer {layer} gate_proj"),
            Self::Up(layer) => write!(f, "layer {layer} up_proj"),
            Self::Gated(layer) => write!(f, "layer {layer} gated MLP"),
            Self::MlpOut(layer) => write!(f, "layer {layer} residual after down_proj"),
            Self::FinalNorm => write!(f, "final norm"),
            Self::Velocity => write!(f, "velocity (action_out_proj)"),
        }
    }
}

/// Why an evaluation fails.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EvalError {
    /// A value does not fit int16 at the specification's scale.
    #[error("{site}: {value} does not fit int16 at the round's scale")]
    OutOfRange {
        /// Where.
        site: Site,
        /// The value.
        value: i64,
    },
    /// Weights, sample or draw were made for other dimensions.
    #[error("{0} does not have the dimensions of the specification")]
    Dimensions(&'static str),
    /// The specification is refused.
    #[error(transparent)]
    Spec(#[from] SpecError),
}

/// Sum of squared errors over the elements that count, in units of 2^(−2·[`EvalSpec::action`]), and their number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LossSum {
    /// Sum of squared errors.
    pub squared_error: u64,
    /// Unpadded frames × real action dimensions.
    pub elements: u64,
}

/// Loss of one sample under `weights` at the flow time and noise of `draw`: squared error of the velocity over
/// unpadded frames and real action dimensions (`loss_valid_only`).
pub fn evaluate(
    spec: &EvalSpec,
    weights: &QuantisedWeights,
    sample: &Sample,
    draw: &Draw,
) -> Result<LossSum, EvalError> {
    Evaluator::new(spec)?.evaluate(weights, sample, draw)
}

/// A valid evaluation specification with what follows from it.
pub struct Evaluator<'a> {
    spec: &'a EvalSpec,
    layout: Layout,
    /// Cosine and sine per position and frequency.
    rotations: Vec<(i16, i16)>,
    /// log2(e)/√head_dim with [`SOFTMAX_BITS`] fraction bits.
    softmax: i64,
}

const SOFTMAX_BITS: i32 = 20;
/// `log2(e)^2 · 2^(2·SOFTMAX_BITS)`, rounded.
const LOG2_E_SQUARED: u64 = 2_288_489_396_308;

/// A tensor of the weights: values and fraction bits.
#[derive(Clone, Copy)]
struct Tensor<'a> {
    values: &'a [i16],
    /// Values used of each row, and from the start of one row to the next.
    columns: usize,
    stride: usize,
    bits: i32,
}

impl<'a> Tensor<'a> {
    fn rows(&self) -> Rows<'a> {
        Rows::strided(self.values, self.stride, self.columns)
    }
}

/// What a linear layer adds to its products.
#[derive(Clone, Copy)]
enum Add<'a> {
    Nothing,
    /// One value per output.
    Bias(Tensor<'a>),
    /// One value per token and output, with these fraction bits.
    Residual(&'a [i16], i32),
    /// One sum per output, with the fraction bits given.
    Sums(&'a [i64], i32),
}

impl<'a> Evaluator<'a> {
    /// Validates the specification and prepares the evaluation: rotations for all positions, tensor layout.
    pub fn new(spec: &'a EvalSpec) -> Result<Self, SpecError> {
        spec.validate()?;
        let dims = &spec.dims;
        let positions = dims.max_prefix + dims.chunk;
        let mut rotations = Vec::with_capacity(positions as usize * spec.rope_frequencies.len());
        for position in 0..positions {
            for &frequency in &spec.rope_frequencies {
                let phase = position.wrapping_mul(frequency);
                rotations.push((tables::cosine(phase), tables::sine(phase)));
            }
        }
        let softmax = integer_sqrt(LOG2_E_SQUARED / dims.head_dim as u64) as i64;
        Ok(Self {
            spec,
            layout: Layout::new(dims),
            rotations,
            softmax,
        })
    }

    /// See [`evaluate`].
    pub fn evaluate(
        &self,
        weights: &QuantisedWeights,
        sample: &Sample,
        draw: &Draw,
    ) -> Result<LossSum, EvalError> {
        let velocity = self.velocity(weights, sample, draw)?;
        let dims = &self.spec.dims;
        let (real, width) = (dims.action_dim as usize, dims.max_action_dim as usize);
        let actions = sample.actions(dims);
        let mut loss = LossSum::default();
        for (frame, velocity) in velocity.chunks_exact(real).enumerate() {
            if sample.is_pad(frame) {
                continue;
            }
            let row = frame * width..frame * width + real;
            let targets = draw.noise[row.clone()].iter().zip(&actions[row]);
            for (&velocity, (&noise, &action)) in velocity.iter().zip(targets) {
                // Each term is below 2^16 in magnitude, three of them squared below 2^36.
                let error = velocity as i64 - (noise as i64 - action as i64);
                loss.squared_error += (error * error) as u64;
            }
            loss.elements += real as u64;
        }
        Ok(loss)
    }

    /// The velocity `v_t` of the real action dimensions, `[frames, action_dim]` with [`EvalSpec::action`] fraction
    /// bits, up to the last frame that is not padding: attention is causal, later frames change nothing.
    pub fn velocity(
        &self,
        weights: &QuantisedWeights,
        sample: &Sample,
        draw: &Draw,
    ) -> Result<Vec<i16>, EvalError> {
        let spec = self.spec;
        let dims = &spec.dims;
        if weights.values.len() != self.layout.len {
            return Err(EvalError::Dimensions("the weights"));
        }
        if sample.values.len() != Sample::len(dims, sample.prefix())
            || sample.prefix() > dims.max_prefix as usize
        {
            return Err(EvalError::Dimensions("the sample"));
        }
        if draw.noise.len() != dims.chunk as usize * dims.max_action_dim as usize {
            return Err(EvalError::Dimensions("the noise"));
        }
        let frames = (0..dims.chunk as usize)
            .rev()
            .find(|&frame| !sample.is_pad(frame));
        let frames = frames.map_or(0, |last| last + 1);
        let mut hidden = self.embed(weights, sample, draw, frames)?;
        let mut bits = spec.hidden;
        for (layer, scales) in spec.layers.iter().enumerate() {
            hidden = self.layer(weights, sample, layer, &hidden, bits)?;
            bits = scales.hidden;
        }
        let head = self.layout.tensors.len() - 3;
        let tensor = |index: usize| self.tensor(weights, head + index);
        let normed = self.norm(Site::FinalNorm, &hidden, bits, tensor(0), spec.final_normed)?;
        // Only the rows of the real action dimensions.
        let (real, width) = (dims.action_dim as usize, dims.expert_width as usize);
        let matrix = Tensor {
            values: &tensor(1).values[..real * width],
            ..tensor(1)
        };
        let add = Add::Bias(Tensor {
            values: &tensor(2).values[..real],
            ..tensor(2)
        });
        self.linear(
            Site::Velocity,
            &normed,
            spec.final_normed,
            matrix,
            add,
            spec.action,
        )
    }

    /// The action tokens: noised action and flow time through their projections.
    fn embed(
        &self,
        weights: &QuantisedWeights,
        sample: &Sample,
        draw: &Draw,
        frames: usize,
    ) -> Result<Vec<i16>, EvalError> {
        let spec = self.spec;
        let dims = &spec.dims;
        let width = dims.expert_width as usize;
        let tensor = |index: usize| self.tensor(weights, index);

        let time = draw.time as i64;
        let mut narrow = Narrow::new();
        let values = frames * dims.max_action_dim as usize;
        let noised: Vec<i16> = draw.noise[..values]
            .iter()
            .zip(sample.actions(dims))
            .map(|(&noise, &action)| {
                let sum = time * noise as i64 + (65536 - time) * action as i64;
                narrow.narrow(round_shift(sum, 16))
            })
            .collect();
        checked(Site::NoisedAction, narrow)?;
        let add = Add::Bias(tensor(1));
        let embedded = self.linear(
            Site::ActionIn,
            &noised,
            spec.action,
            tensor(0),
            add,
            spec.embedding,
        )?;

        // action_time_mlp_in sees [embedded action, time embedding]. The second half is the same for every token:
        // its sums are computed once, with the bias, and added.
        let phase = |&frequency: &u64| ((draw.time as u64 * frequency) >> 16) as u32;
        let phases = || spec.time_frequencies.iter().map(phase);
        let time_embedding: Vec<i16> = phases()
            .map(tables::sine)
            .chain(phases().map(tables::cosine))
            .collect();
        let (matrix, bias) = (tensor(2), tensor(3));
        let time_bits = matrix.bits + tables::TRIG_BITS as i32;
        let rows = matrix.values.chunks_exact(2 * width);
        let sums: Vec<i64> = rows
            .zip(bias.values)
            .map(|(row, &bias_value)| {
                let bias = align(bias_value as i64, bias.bits, time_bits);
                bias + dot(&row[width..], &time_embedding)
            })
            .collect();
        // The first half of each row.
        let matrix = Tensor {
            columns: width,
            ..matrix
        };
        let add = Add::Sums(&sums, time_bits);
        let mut mixed = self.linear(
            Site::TimeMlpIn,
            &embedded,
            spec.embedding,
            matrix,
            add,
            spec.time_hidden,
        )?;

        let bits = spec.time_hidden as u32;
        let rescale = Rescale::new(
            (bits + tables::SIGMOID_BITS) as i32,
            spec.time_activation as i32,
        );
        let mut narrow = Narrow::new();
        for value in &mut mixed {
            let silu = *value as i64 * tables::sigmoid(*value, bits);
            *value = narrow.narrow(rescale.apply(silu));
        }
        checked(Site::TimeMlpSilu, narrow)?;
        let add = Add::Bias(tensor(5));
        self.linear(
            Site::TimeMlpOut,
            &mixed,
            spec.time_activation,
            tensor(4),
            add,
            spec.hidden,
        )
    }

    /// One transformer layer over the action tokens; `hidden` has `bits` fraction bits, the result `hidden` of the
    /// layer's scales.
    fn layer(
        &self,
        weights: &QuantisedWeights,
        sample: &Sample,
        layer: usize,
        hidden: &[i16],
        bits: u8,
    ) -> Result<Vec<i16>, EvalError> {
        let scales = &self.spec.layers[layer];
        let first = HEAD_TENSORS + layer * LAYER_TENSORS;
        let tensor = |index: usize| self.tensor(weights, first + index);
        let linear = |site, input: &[i16], bits, index, add, out| {
            self.linear(site, input, bits, tensor(index), add, out)
        };
        let nothing = Add::Nothing;

        let normed = self.norm(
            Site::InputNorm(layer),
            hidden,
            bits,
            tensor(0),
            scales.normed,
        )?;
        let mut queries = linear(
            Site::Query(layer),
            &normed,
            scales.normed,
            1,
            nothing,
            scales.query,
        )?;
        let (cached_keys, cached_values) = sample.cache(&self.spec.dims, layer);
        let self_attention = self.spec.dims.is_self_attention(layer);
        let (keys, values);
        if self_attention {
            let mut own_keys = linear(
                Site::Key(layer),
                &normed,
                scales.normed,
                2,
                nothing,
                scales.key,
            )?;
            let own_values = linear(
                Site::Value(layer),
                &normed,
                scales.normed,
                3,
                nothing,
                scales.value,
            )?;
            let dims = &self.spec.dims;
            let start = sample.prefix();
            self.rotate(
                Site::RotatedQuery(layer),
                &mut queries,
                dims.query_width(),
                start,
            )?;
            self.rotate(
                Site::RotatedKey(layer),
                &mut own_keys,
                dims.kv_width(),
                start,
            )?;
            keys = [cached_keys, &own_keys].concat();
            values = [cached_values, &own_values].concat();
        } else {
            self.rotate(
                Site::RotatedQuery(layer),
                &mut queries,
                self.spec.dims.query_width(),
                0,
            )?;
            keys = linear(
                Site::Key(layer),
                cached_keys,
                scales.cache_key,
                2,
                nothing,
                scales.key,
            )?;
            values = linear(
                Site::Value(layer),
                cached_values,
                scales.cache_value,
                3,
                nothing,
                scales.value,
            )?;
        }
        let attention = self.attend(
            Site::Attention(layer),
            scales,
            &queries,
            &keys,
            &values,
            sample.prefix(),
            self_attention,
        )?;
        let add = Add::Residual(hidden, bits as i32);
        let attended = linear(
            Site::Attended(layer),
            &attention,
            scales.value,
            4,
            add,
            scales.attended,
        )?;

        let normed = self.norm(
            Site::MlpNorm(layer),
            &attended,
            scales.attended,
            tensor(5),
            scales.mlp_normed,
        )?;
        let mut gate = linear(
            Site::Gate(layer),
            &normed,
            scales.mlp_normed,
            6,
            nothing,
            scales.gate,
        )?;
        let up = linear(
            Site::Up(layer),
            &normed,
            scales.mlp_normed,
            7,
            nothing,
            scales.up,
        )?;
        let from = (scales.gate + scales.up) as i32 + tables::SIGMOID_BITS as i32;
        let rescale = Rescale::new(from, scales.gated as i32);
        let mut narrow = Narrow::new();
        for (gate, &up) in gate.iter_mut().zip(&up) {
            let silu = *gate as i64 * tables::sigmoid(*gate, scales.gate as u32);
            *gate = narrow.narrow(rescale.apply(silu * up as i64));
        }
        checked(Site::Gated(layer), narrow)?;
        let add = Add::Residual(&attended, scales.attended as i32);
        linear(
            Site::MlpOut(layer),
            &gate,
            scales.gated,
            8,
            add,
            scales.hidden,
        )
    }

    /// Grouped-query attention of each action token over `prefix` tokens and, in self-attention, the action tokens up
    /// to itself. Weights of the softmax are 2^(−x) of the distance to the largest score, as int16; the output is their
    /// mean of the values, one division each.
    #[allow(clippy::too_many_arguments)]
    fn attend(
        &self,
        site: Site,
        scales: &LayerScales,
        queries: &[i16],
        keys: &[i16],
        values: &[i16],
        prefix: usize,
        causal: bool,
    ) -> Result<Vec<i16>, EvalError> {
        let dims = &self.spec.dims;
        let (head_dim, kv_width) = (dims.head_dim as usize, dims.kv_width());
        let group = dims.heads as usize / dims.kv_heads as usize;
        // Scores have query + key fraction bits; the exponent of 2 has 12.
        let exponent = Rescale::new((scales.query + scales.key) as i32 + SOFTMAX_BITS, 12);
        let tokens = keys.len() / kv_width;
        let transposed = transpose(values, kv_width);
        let mut output = vec![0; queries.len()];
        let mut scores = vec![0i64; group * tokens];
        let mut weights = vec![0i16; group * tokens];
        let mut sums = vec![0i64; group * head_dim];
        let mut narrow = Narrow::new();
        let heads = queries.chunks_exact(group * head_dim);
        for (index, (queries, output)) in heads
            .zip(output.chunks_exact_mut(group * head_dim))
            .enumerate()
        {
            let (token, kv_head) = (
                index / dims.kv_heads as usize,
                index % dims.kv_heads as usize,
            );
            let visible = if causal { prefix + token + 1 } else { prefix };
            let keys = &keys[..visible * kv_width][kv_head * head_dim..];
            let scores = &mut scores[..group * visible];
            let keys = Rows::strided(keys, kv_width, head_dim);
            products(Rows::new(queries, head_dim), keys, |index, _, sum| {
                scores[index] = sum
            });
            let weights = &mut weights[..group * visible];
            for (scores, weights) in scores
                .chunks_exact(visible)
                .zip(weights.chunks_exact_mut(visible))
            {
                let largest = scores
                    .iter()
                    .fold(i64::MIN, |largest, &score| largest.max(score));
                for (&score, weight) in scores.iter().zip(weights) {
                    // Below 2^39 · 2^21.
                    let distance = exponent.apply((largest - score) * self.softmax);
                    *weight = tables::exp2_negative(distance as u64);
                }
            }
            let values = &transposed[kv_head * head_dim * tokens..][..head_dim * tokens];
            let values = Rows::strided(values, tokens, visible);
            products(Rows::new(weights, visible), values, |index, _, sum| {
                sums[index] = sum
            });
            let rows = sums
                .chunks_exact(head_dim)
                .zip(output.chunks_exact_mut(head_dim));
            for ((sums, output), weights) in rows.zip(weights.chunks_exact(visible)) {
                let total = weights.iter().map(|&weight| weight as i64).sum();
                for (&sum, output) in sums.iter().zip(output) {
                    *output = narrow.narrow(round_divide(sum, total));
                }
            }
        }
        checked(site, narrow)?;
        Ok(output)
    }

    /// RoPE over rows of heads: halves rotated, base 10,000, row `i` at position `start + i`.
    fn rotate(
        &self,
        site: Site,
        rows: &mut [i16],
        width: usize,
        start: usize,
    ) -> Result<(), EvalError> {
        let head_dim = self.spec.dims.head_dim as usize;
        let half = head_dim / 2;
        let mut narrow = Narrow::new();
        for (row, values) in rows.chunks_exact_mut(width).enumerate() {
            let rotations = &self.rotations[(start + row) * half..][..half];
            for head in values.chunks_exact_mut(head_dim) {
                let (low, high) = head.split_at_mut(half);
                for ((low, high), &(cosine, sine)) in low.iter_mut().zip(high).zip(rotations) {
                    let (a, b) = (*low as i64, *high as i64);
                    let (cosine, sine) = (cosine as i64, sine as i64);
                    *low = narrow.narrow(round_shift(a * cosine - b * sine, tables::TRIG_BITS));
                    *high = narrow.narrow(round_shift(b * cosine + a * sine, tables::TRIG_BITS));
                }
            }
        }
        checked(site, narrow)
    }

    /// RMSNorm with eps 1e-5 over rows of the expert's width: `x · gain / √(mean(x²) + eps)`, one division each.
    fn norm(
        &self,
        site: Site,
        input: &[i16],
        bits: u8,
        gain: Tensor<'_>,
        out: u8,
    ) -> Result<Vec<i16>, EvalError> {
        /// 1e-5 with 32 fraction bits.
        const EPS: u64 = 42_950;
        let width = gain.values.len();
        let eps = EPS << (2 * bits as u32);
        let mut output = Vec::with_capacity(input.len());
        let mut narrow = Narrow::new();
        for row in input.chunks_exact(width) {
            let squares = dot(row, row) as u64;
            let (whole, rest) = (squares / width as u64, squares % width as u64);
            // Mean square with 2·bits + 32 fraction bits, at most 2^62; its root has bits + 16.
            let mean = (whole << 32) + (rest << 32) / width as u64;
            let root = integer_sqrt(mean + eps) as i64;
            // x·gain has bits + gain.bits fraction bits, the quotient is to have `out`. Numerator below 2^30 · 2^31,
            // denominator below 2^32 · 2^24.
            let denominator = root << gain.bits;
            for (&x, &gain) in row.iter().zip(gain.values) {
                let product = (x as i64 * gain as i64) << (16 + out as u32);
                output.push(narrow.narrow(round_divide(product, denominator)));
            }
        }
        checked(site, narrow)?;
        Ok(output)
    }

    /// `input · matrixᵀ + add` over rows of tokens. `matrix` is `[outputs, inputs]`; the result has `out` fraction bits.
    fn linear(
        &self,
        site: Site,
        input: &[i16],
        bits: u8,
        matrix: Tensor<'_>,
        add: Add<'_>,
        out: u8,
    ) -> Result<Vec<i16>, EvalError> {
        let sum_bits = matrix.bits + bits as i32;
        let (input, matrix) = (Rows::new(input, matrix.columns), matrix.rows());
        let mut output = vec![0; input.count() * matrix.count()];
        let mut narrow = Narrow::new();
        let out = Rescale::new(sum_bits, out as i32);
        match add {
            Add::Nothing => products(input, matrix, |index, _, sum| {
                output[index] = narrow.narrow(out.apply(sum));
            }),
            Add::Bias(bias) => {
                let rescale = Rescale::new(bias.bits, sum_bits);
                products(input, matrix, |index, column, sum| {
                    let add = rescale.apply(bias.values[column] as i64);
                    output[index] = narrow.narrow(out.apply(sum + add));
                });
            }
            Add::Sums(sums, from) => {
                let rescale = Rescale::new(from, sum_bits);
                products(input, matrix, |index, column, sum| {
                    output[index] = narrow.narrow(out.apply(sum + rescale.apply(sums[column])));
                });
            }
            Add::Residual(values, from) => {
                let rescale = Rescale::new(from, sum_bits);
                products(input, matrix, |index, _, sum| {
                    let add = rescale.apply(values[index] as i64);
                    output[index] = narrow.narrow(out.apply(sum + add));
                });
            }
        }
        checked(site, narrow)?;
        Ok(output)
    }

    fn tensor<'w>(&self, weights: &'w QuantisedWeights, index: usize) -> Tensor<'w> {
        let values = weights.values.as_slice();
        let place = self.layout.tensors[index];
        let bits = values[index] as i32;
        Tensor {
            values: &values[place.start..][..place.len],
            columns: place.columns,
            stride: place.columns,
            bits,
        }
    }
}

/// `[rows, width]` as `[width, rows]`.
fn transpose(values: &[i16], width: usize) -> Vec<i16> {
    let rows = values.len() / width;
    let mut transposed = vec![0; values.len()];
    for (row, values) in values.chunks_exact(width).enumerate() {
        for (&value, column) in values.iter().zip(transposed.chunks_exact_mut(rows)) {
            column[row] = value;
        }
    }
    transposed
}

fn checked(site: Site, narrow: Narrow) -> Result<(), EvalError> {
    match narrow.refused {
        None => Ok(()),
        Some(value) => Err(EvalError::OutOfRange { site, value }),
    }
}
