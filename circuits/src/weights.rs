//! The expert's weights as int16 tensors with power-of-two scales that follow from the weights by rule.

use crate::{
    digest::tagged_sha256,
    linear::bit_limits,
    poseidon2::{hash, Domain},
    spec::{Dims, EvalSpec},
    statement::Mode,
    values::Values,
    Digest,
};
use alloc::{format, string::String, vec, vec::Vec};

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

/// The tensors of the action expert in the canonical order: that of quantised weights, digests and aggregation.
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

/// Where each tensor of [`expert_tensors`] lies, without names: what the guest computes.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    /// Where each tensor lies.
    pub tensors: Vec<Place>,
    /// Length of the whole buffer: one scale per tensor, then the values.
    pub len: usize,
}

/// Where a tensor lies in the buffer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub start: usize,
    pub len: usize,
    /// Whether it is the matrix of a linear layer.
    pub is_matrix: bool,
}

/// Tensors before the first layer, and in each layer.
pub(crate) const HEAD_TENSORS: usize = 6;
pub(crate) const LAYER_TENSORS: usize = 9;

impl Layout {
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

/// Why weights cannot be quantised.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum QuantiseError {
    /// A tensor is not there.
    #[error("tensor {0} is missing")]
    Missing(String),
    /// A tensor has the wrong size.
    #[error("tensor {name} has {found} values, expected {expected}")]
    Length {
        /// Which.
        name: String,
        /// Values needed.
        expected: usize,
        /// Values there.
        found: usize,
    },
    /// A value is NaN or infinite.
    #[error("{name}[{index}] is {value}: weights and samples must be finite")]
    NotFinite {
        /// Which tensor.
        name: String,
        /// Flat index.
        index: usize,
        /// The value.
        value: f32,
    },
    /// A value does not fit int16 at its scale.
    #[error(
        "{name}[{index}] = {value} does not fit: the largest magnitude at this scale is {limit}"
    )]
    TooLarge {
        /// Which tensor.
        name: String,
        /// Flat index.
        index: usize,
        /// The value.
        value: f32,
        /// Largest magnitude that fits.
        limit: f32,
    },
    /// The specification itself is refused.
    #[error(transparent)]
    Spec(#[from] crate::spec::SpecError),
}

/// All weights of the expert as int16.
///
/// One buffer: first the fraction bits of each tensor, then the tensors' values, both in the order of
/// [`expert_tensors`]. A tensor's fraction bits are the most, up to [`MAX_WEIGHT_BITS`], with which its largest
/// magnitude still rounds to an int16 (−32767 ..= 32767; ties to even).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct QuantisedWeights {
    pub(crate) values: Values,
}

/// Why a buffer is not quantised weights.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WeightsError {
    /// Wrong size.
    #[error("quantised weights take {expected} bytes, got {found} (or padding is not zero)")]
    Length {
        /// Bytes needed.
        expected: usize,
        /// Bytes there.
        found: usize,
    },
    /// A scale out of bounds.
    #[error("tensor {index} has {bits} fraction bits, must be within {least} ..= {most}")]
    Scale {
        /// Which tensor, in canonical order.
        index: usize,
        /// Its fraction bits.
        bits: i16,
        /// Least allowed at the specification's scales.
        least: i16,
        /// Most allowed.
        most: i16,
    },
}

impl QuantisedWeights {
    /// Quantises the tensors that `get` returns by name.
    pub fn quantise<'a>(
        spec: &EvalSpec,
        get: impl Fn(&str) -> Option<&'a [f32]>,
    ) -> Result<Self, QuantiseError> {
        spec.validate()?;
        let tensors = expert_tensors(&spec.dims);
        let layout = Layout::new(&spec.dims);
        // Sizes are checked before the buffer is allocated: it is never larger than what was given.
        for tensor in &tensors {
            let found =
                get(&tensor.name).ok_or_else(|| QuantiseError::Missing(tensor.name.clone()))?;
            let (expected, found) = (tensor.len(), found.len());
            if expected != found {
                let name = tensor.name.clone();
                return Err(QuantiseError::Length {
                    name,
                    expected,
                    found,
                });
            }
        }
        let quantiser = Quantiser {
            limits: bit_limits(spec, tensors.len()),
            tensors,
        };
        let mut values = Values::zeros(layout.len);
        let all = values.as_mut_slice();
        for (index, place) in layout.tensors.iter().enumerate() {
            let source = get(&quantiser.tensors[index].name).unwrap_or_default();
            all[index] = quantiser.quantise(index, source, &mut all[place.start..][..place.len])?;
        }
        Ok(Self { values })
    }

    /// Reads the bytes of [`Self::as_bytes`].
    pub fn from_bytes(spec: &EvalSpec, bytes: &[u8]) -> Result<Self, WeightsError> {
        let layout = Layout::new(&spec.dims);
        let values = Values::from_bytes(bytes, layout.len).ok_or(WeightsError::Length {
            expected: Values::byte_len(layout.len),
            found: bytes.len(),
        })?;
        let scales = &values.as_slice()[..layout.tensors.len()];
        check_bits(spec, scales.iter().map(|&bits| Some(bits)))?;
        Ok(Self { values })
    }

    /// Little-endian int16: scales, values, zero padding to a multiple of 8 bytes.
    pub fn as_bytes(&self) -> &[u8] {
        self.values.as_bytes()
    }

    /// The values of tensor number `index`, row-major, and their fraction bits.
    pub(crate) fn tensor(&self, layout: &Layout, index: usize) -> (&[i16], i16) {
        let values = self.values.as_slice();
        let place = layout.tensors[index];
        (&values[place.start..][..place.len], values[index])
    }

    /// Digest over scales and values: [`crate::WeightsDigest::quantised`]. Poseidon2 in mode `direct`, where the guest computes
    /// it; SHA-256 in mode `checked`, where only verifiers do, in a tenth of the time.
    pub fn digest(&self, mode: Mode) -> Digest {
        match mode {
            Mode::Direct => hash(Domain::Weights, &self.values),
            Mode::Checked => tagged_sha256("zk0/quantised/v1", &[self.as_bytes()]),
        }
    }
}

/// Quantises the expert's tensors one at a time.
pub struct Quantiser {
    tensors: Vec<TensorSpec>,
    limits: Vec<(i16, i16)>,
}

impl Quantiser {
    /// For the tensors of a valid specification.
    pub fn new(spec: &EvalSpec) -> Self {
        let tensors = expert_tensors(&spec.dims);
        let limits = bit_limits(spec, tensors.len());
        Self { tensors, limits }
    }

    /// The tensors, in canonical order.
    pub fn tensors(&self) -> &[TensorSpec] {
        &self.tensors
    }

    /// Quantises tensor number `index` into `target`, which is as long; returns its fraction bits.
    pub fn quantise(
        &self,
        index: usize,
        source: &[f32],
        target: &mut [i16],
    ) -> Result<i16, QuantiseError> {
        let name = &self.tensors[index].name;
        let bits = weight_bits(name, source, self.limits[index])?;
        quantise_into(name, source, bits as u32, target)?;
        Ok(bits)
    }
}

/// Checks the fraction bits of the tensors that there are.
pub(crate) fn check_bits(
    spec: &EvalSpec,
    tensors: impl ExactSizeIterator<Item = Option<i16>>,
) -> Result<(), WeightsError> {
    let limits = bit_limits(spec, tensors.len());
    for (index, (bits, (least, most))) in tensors.zip(limits).enumerate() {
        match bits {
            Some(bits) if !(least..=most).contains(&bits) => {
                return Err(WeightsError::Scale {
                    index,
                    bits,
                    least,
                    most,
                })
            }
            _ => {}
        }
    }
    Ok(())
}

/// The rule for a tensor's fraction bits.
fn weight_bits(name: &str, values: &[f32], limits: (i16, i16)) -> Result<i16, QuantiseError> {
    let mut largest = (0, 0f32);
    for (index, &value) in values.iter().enumerate() {
        if !value.is_finite() {
            return Err(QuantiseError::NotFinite {
                name: name.into(),
                index,
                value,
            });
        }
        if value.abs() > largest.1.abs() {
            largest = (index, value);
        }
    }
    let (index, value) = largest;
    (limits.0..=limits.1)
        .rev()
        .find(|&bits| fixed(value, bits as u32).is_some())
        .ok_or(QuantiseError::TooLarge {
            name: name.into(),
            index,
            value,
            limit: 32767.0 / (1u64 << limits.0) as f32,
        })
}

/// Quantises `source` with `bits` fraction bits into `target`, which is as long.
pub(crate) fn quantise_into(
    name: &str,
    source: &[f32],
    bits: u32,
    target: &mut [i16],
) -> Result<(), QuantiseError> {
    for (index, (&value, target)) in source.iter().zip(target).enumerate() {
        if !value.is_finite() {
            return Err(QuantiseError::NotFinite {
                name: name.into(),
                index,
                value,
            });
        }
        *target = fixed(value, bits).ok_or_else(|| QuantiseError::TooLarge {
            name: name.into(),
            index,
            value,
            limit: 32767.0 / (1u64 << bits) as f32,
        })?;
    }
    Ok(())
}

/// `value · 2^bits` rounded to the nearest integer, ties to even; `None` beyond ±32767.
///
/// Exact on every machine: the product by a power of two is exact in f64, and adding and subtracting 1.5 · 2^52 rounds.
fn fixed(value: f32, bits: u32) -> Option<i16> {
    const ROUND: f64 = 6755399441055744.0;
    let scaled = value as f64 * (1u64 << bits) as f64;
    if scaled.abs() > 40000.0 {
        return None;
    }
    let rounded = (scaled + ROUND) - ROUND;
    (rounded.abs() <= 32767.0).then_some(rounded as i16)
}
