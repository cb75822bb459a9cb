//! Fixed-point evaluation of the action expert: the flow-matching loss of one sample. It gives the same bits on every machine and
//! in the guest. Mode `direct` runs it there, and mode `succinct` proves what it gives.
//!
//! It follows SmolVLA as LeRobot computes it (arXiv 2506.01844; lerobot 0.4.4). Activations and weights are int16. Sums are
//! int64, and a linear layer keeps 32 bits of them ([`crate::model::linear`]), so that each output is rounded once.

use crate::model::arithmetic::products::Rows;
use crate::model::arithmetic::tables;
use crate::model::draw::Draw;
use crate::model::elementwise::{add, noised, norm, outputs, rotate, silu, swiglu, Softmax};
use crate::model::layout::{Layout, HEAD_TENSORS, LAYER_TENSORS};
use crate::model::linear::{first_of_layer, linears, place, Linear};
use crate::model::multiply::{Direct, Multiply};
use crate::model::sample::Sample;
use crate::model::spec::{EvalSpec, LayerScales, SpecError};
use crate::model::weights::QuantisedWeights;
use crate::vm::budget::operation;
use alloc::vec;
use alloc::vec::Vec;

pub use crate::model::site::{EvalError, Overflow, Site};

use crate::model::site::Narrowing;

/// Sum of squared errors over the elements that count, in units of 2^(−2·[`EvalSpec::action`]), and their number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LossSum {
    /// Sum of squared errors.
    pub squared_error: u64,
    /// Unpadded frames × real action dimensions.
    pub elements: u64,
}

/// Computes the loss of one sample under `weights` at the flow time and noise of `draw`: squared error of the velocity over
/// unpadded frames and real action dimensions (`loss_valid_only`).
pub fn evaluate(
    spec: &EvalSpec,
    weights: &QuantisedWeights,
    sample: &Sample,
    draw: &Draw,
    overflow: Overflow,
) -> Result<LossSum, EvalError> {
    let evaluator = Evaluator::new(spec)?;
    let mut direct = evaluator.direct(weights, overflow)?;
    evaluator.loss(&mut direct, sample, draw)
}

/// How values of a model are narrowed at a place.
fn narrowing(multiply: &impl Multiply) -> impl Fn(Site) -> Narrowing {
    let overflow = multiply.overflow();
    move |site| Narrowing { site, overflow }
}

/// A valid evaluation specification, and what follows from it.
pub struct Evaluator<'a> {
    /// The specification.
    pub spec: &'a EvalSpec,
    /// Where the tensors lie.
    pub(crate) layout: Layout,
    /// The linear layers.
    pub linears: Vec<Linear>,
    /// Cosine and sine per position and frequency.
    rotations: Vec<(i16, i16)>,
}

/// The gain of a layer's second norm, counted from the layer's first tensor, which is the first norm's gain.
const MLP_GAIN: usize = 5;

impl<'a> Evaluator<'a> {
    /// Validates the specification and prepares the evaluation: rotations for all positions, linear layers.
    pub fn new(spec: &'a EvalSpec) -> Result<Self, SpecError> {
        spec.validate()?;
        let dims = &spec.dims;
        let positions = dims.max_prefix + dims.chunk;
        let mut rotations = Vec::with_capacity(positions as usize * spec.rope_frequencies.len());
        for position in 0..positions {
            for &frequency in &spec.rope_frequencies {
                let phase = position.wrapping_mul(frequency);
                rotations.push(tables::turn(phase));
            }
        }
        Ok(Self {
            spec,
            layout: Layout::new(dims),
            linears: linears(spec),
            rotations,
        })
    }

    /// Prepares to compute products with `weights`.
    pub fn direct<'w>(
        &'w self,
        weights: &'w QuantisedWeights,
        overflow: Overflow,
    ) -> Result<Direct<'w>, EvalError> {
        Direct::new(self.spec, &self.layout, weights, overflow)
    }

    /// Does what [`evaluate`] does, with the weights and products of `multiply`.
    pub fn loss(
        &self,
        multiply: &mut impl Multiply,
        sample: &Sample,
        draw: &Draw,
    ) -> Result<LossSum, EvalError> {
        let velocity = self.velocity(multiply, sample, draw)?;
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
    /// bits, up to the last frame that is not padding. Attention is causal, so that later frames change nothing.
    pub fn velocity(
        &self,
        multiply: &mut impl Multiply,
        sample: &Sample,
        draw: &Draw,
    ) -> Result<Vec<i16>, EvalError> {
        let spec = self.spec;
        let dims = &spec.dims;
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
        let mut hidden = self.embed(multiply, sample, draw, frames)?;
        let mut bits = spec.hidden;
        for (layer, scales) in spec.layers.iter().enumerate() {
            hidden = self.layer(multiply, sample, layer, &hidden, bits)?;
            bits = scales.hidden;
        }
        let layers = spec.layers.len();
        let at = narrowing(multiply);
        let gain = multiply.gain(HEAD_TENSORS + layers * LAYER_TENSORS);
        let normed = norm(at(Site::FinalNorm), &hidden, bits, gain, spec.final_normed)?;
        let sums = self.linear(multiply, first_of_layer(layers), &normed)?;
        Ok(outputs(&sums).collect())
    }

    fn linear(
        &self,
        multiply: &mut impl Multiply,
        index: usize,
        input: &[i16],
    ) -> Result<Vec<i32>, EvalError> {
        multiply.linear(index, &self.linears[index], input)
    }

    /// The action tokens: noised action and flow time through their projections.
    fn embed(
        &self,
        multiply: &mut impl Multiply,
        sample: &Sample,
        draw: &Draw,
        frames: usize,
    ) -> Result<Vec<i16>, EvalError> {
        let spec = self.spec;
        let dims = &spec.dims;
        let width = dims.expert_width as usize;
        let values = frames * dims.max_action_dim as usize;
        let actions = sample.actions(dims);
        let noised = noised(draw.time, &draw.noise[..values], &actions[..values])?;
        let embedded = self.linear(multiply, 0, &noised)?;
        // Each token's embedded action, followed by the time embedding, the same for all.
        let phase = |&frequency: &u64| ((draw.time as u64 * frequency) >> 16) as u32;
        let phases = || spec.time_frequencies.iter().map(phase);
        let rescale = |value: i16| {
            let rounded = (value as i64) << spec.embedding;
            ((rounded + (1 << (tables::TRIG_BITS - 1))) >> tables::TRIG_BITS) as i16
        };
        let time_embedding: Vec<i16> = phases()
            .map(tables::sine)
            .chain(phases().map(tables::cosine))
            .map(rescale)
            .collect();
        let mut joined = Vec::with_capacity(2 * embedded.len());
        for row in embedded.chunks_exact(width) {
            joined.extend(outputs(row));
            joined.extend_from_slice(&time_embedding);
        }
        let mixed = self.linear(multiply, 1, &joined)?;
        let mixed = silu(
            narrowing(multiply)(Site::TimeMlpSilu),
            &mixed,
            spec.time_hidden,
            spec.time_activation,
        )?;
        let hidden = self.linear(multiply, 2, &mixed)?;
        Ok(outputs(&hidden).collect())
    }

    /// One transformer layer over the action tokens; `hidden` has `bits` fraction bits, the result `hidden` of the
    /// layer's scales.
    fn layer(
        &self,
        multiply: &mut impl Multiply,
        sample: &Sample,
        layer: usize,
        hidden: &[i16],
        bits: u8,
    ) -> Result<Vec<i16>, EvalError> {
        let dims = &self.spec.dims;
        let scales = &self.spec.layers[layer];
        let gains = HEAD_TENSORS + layer * LAYER_TENSORS;
        let first = first_of_layer(layer);

        let at = narrowing(multiply);
        let site = at(Site::InputNorm(layer));
        let normed = norm(site, hidden, bits, multiply.gain(gains), scales.normed)?;
        let projected = self.linear(multiply, first + place::QUERY, &normed)?;
        let frames = hidden.len() / dims.expert_width as usize;
        let (queries, own) = projected.split_at(frames * dims.query_width());
        let (cached_keys, cached_values) = sample.cache(dims, layer);
        let causal = dims.is_self_attention(layer);
        let start = if causal { sample.prefix() } else { 0 };
        let queries = self.rotate_queries(at(Site::RotatedQuery(layer)), queries, frames, start)?;
        let (mut keys, mut values);
        if causal {
            let (own_keys, own_values) = own.split_at(frames * dims.kv_width());
            keys = Vec::with_capacity(cached_keys.len() + own_keys.len());
            keys.extend_from_slice(cached_keys);
            keys.resize(cached_keys.len() + own_keys.len(), 0);
            let site = at(Site::RotatedKey(layer));
            self.rotate_keys(site, own_keys, start, &mut keys[cached_keys.len()..])?;
            values = Vec::with_capacity(cached_values.len() + own_values.len());
            values.extend_from_slice(cached_values);
            values.extend(outputs(own_values));
        } else {
            let sums = self.linear(multiply, first + place::KEY, cached_keys)?;
            keys = outputs(&sums).collect();
            let sums = self.linear(multiply, first + place::VALUE, cached_values)?;
            values = outputs(&sums).collect();
        }
        let visible = |token: usize| {
            if causal {
                start + token + 1
            } else {
                sample.prefix()
            }
        };
        let attention = self.attend(multiply, layer, &queries, &keys, &values, visible)?;
        let sums = self.linear(multiply, first + place::OUT, &attention)?;
        let site = at(Site::Attended(layer));
        let attended = add(site, &sums, hidden, bits, scales.attended)?;

        let normed = norm(
            at(Site::MlpNorm(layer)),
            &attended,
            scales.attended,
            multiply.gain(gains + MLP_GAIN),
            scales.mlp_normed,
        )?;
        let sums = self.linear(multiply, first + place::GATE_UP, &normed)?;
        let (gate, up) = sums.split_at(sums.len() / 2);
        let gated = swiglu(
            at(Site::Gated(layer)),
            (gate, scales.gate),
            (up, scales.up),
            scales.gated,
        )?;
        let sums = self.linear(multiply, first + place::DOWN, &gated)?;
        add(
            at(Site::MlpOut(layer)),
            &sums,
            &attended,
            scales.attended,
            scales.hidden,
        )
    }

    /// Rotated queries, grouped by the key/value head they attend to: `[kv_heads, frames, group, head_dim]`.
    fn rotate_queries(
        &self,
        at: Narrowing,
        sums: &[i32],
        frames: usize,
        start: usize,
    ) -> Result<Vec<i16>, EvalError> {
        let dims = &self.spec.dims;
        let (head_dim, group) = (dims.head_dim as usize, dims.group());
        let mut queries = vec![0; sums.len()];
        rotate(
            at,
            sums,
            (dims.query_width(), head_dim),
            self.rotations(start),
            &mut queries,
            |row, head| (((head / group) * frames + row) * group + head % group) * head_dim,
        )?;
        Ok(queries)
    }

    /// Rotated keys, in place of `target`.
    fn rotate_keys(
        &self,
        at: Narrowing,
        sums: &[i32],
        start: usize,
        target: &mut [i16],
    ) -> Result<(), EvalError> {
        let dims = &self.spec.dims;
        let (head_dim, width) = (dims.head_dim as usize, dims.kv_width());
        rotate(
            at,
            sums,
            (width, head_dim),
            self.rotations(start),
            target,
            |row, head| row * width + head * head_dim,
        )
    }

    /// Rotations from position `start` on.
    fn rotations(&self, start: usize) -> &[(i16, i16)] {
        &self.rotations[start * self.spec.rope_frequencies.len()..]
    }

    /// Grouped-query attention: every query of token `i` attends to the first `visible(i)` keys. Scores with the other keys
    /// have no weight. The result has one row per token.
    fn attend(
        &self,
        multiply: &mut impl Multiply,
        layer: usize,
        queries: &[i16],
        keys: &[i16],
        values: &[i16],
        visible: impl Fn(usize) -> usize,
    ) -> Result<Vec<i16>, EvalError> {
        let dims = &self.spec.dims;
        let scales: &LayerScales = &self.spec.layers[layer];
        let (head_dim, kv_width) = (dims.head_dim as usize, dims.kv_width());
        let (group, query_width) = (dims.group(), dims.query_width());
        let softmax = Softmax::new(dims.head_dim, (scales.query + scales.key) as u32);
        let tokens = keys.len() / kv_width;
        let mut output = vec![0; queries.len()];
        let per_head = queries.len() / dims.kv_heads as usize;
        let mut weights = vec![0i16; per_head / head_dim * tokens];
        for kv_head in 0..dims.kv_heads as usize {
            let head = |rows| Rows::strided(rows, kv_width, head_dim);
            let queries = Rows::new(&queries[kv_head * per_head..][..per_head], head_dim);
            let keys = head(&keys[kv_head * head_dim..]);
            let seen = |row: usize| visible(row / group);
            let scores = multiply.scores(layer, queries, keys, seen);
            let in_softmax = operation("softmax");
            let rows = scores
                .chunks_exact(tokens)
                .zip(weights.chunks_exact_mut(tokens));
            for (row, (scores, weights)) in rows.enumerate() {
                let visible = seen(row);
                softmax.apply(&scores[..visible], &mut weights[..visible]);
            }
            in_softmax.end();
            let values = head(&values[kv_head * head_dim..]);
            let weights = Rows::new(&weights, tokens);
            let mixed = multiply.mix(Site::Attention(layer), weights, values)?;
            for (token, mixed) in mixed.chunks_exact(group * head_dim).enumerate() {
                let target = &mut output[token * query_width + kv_head * group * head_dim..];
                for (target, value) in target.iter_mut().zip(outputs(mixed)) {
                    *target = value;
                }
            }
        }
        Ok(output)
    }
}
