//! The evaluation specification: dimensions, activation scales, frequencies. It is public and fixed by the round. A node chooses
//! nothing of it.

use crate::vm::digest::{tagged_sha256, Digest};
use alloc::vec;
use alloc::vec::Vec;
use borsh::{BorshDeserialize, BorshSerialize};

/// Version of [`EvalSpec`]'s encoding and of the arithmetic it specifies.
pub const EVAL_VERSION: u16 = 3;

/// Dimensions of the action expert and of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Dims {
    /// Width of the expert's residual stream; even (half of the time embedding is sines).
    pub expert_width: u32,
    /// Width of the expert's SwiGLU.
    pub expert_mlp: u32,
    /// Query heads.
    pub heads: u32,
    /// Key and value heads; divides `heads`.
    pub kv_heads: u32,
    /// Width of a head; even (RoPE rotates halves).
    pub head_dim: u32,
    /// Layers.
    pub layers: u32,
    /// Layer `i` is a self-attention layer when `i` is a multiple of this, else it attends to the prefix alone.
    pub self_attn_every: u32,
    /// Action frames in a chunk.
    pub chunk: u32,
    /// Action dimensions the model sees.
    pub max_action_dim: u32,
    /// Action dimensions that are real, and count in the loss.
    pub action_dim: u32,
    /// Most valid prefix tokens a sample may have.
    pub max_prefix: u32,
}

impl Dims {
    /// The `micro` profile: one claim over 4 samples is about 2 M guest cycles.
    pub const MICRO: Self = Self {
        expert_width: 12,
        expert_mlp: 32,
        heads: 2,
        kv_heads: 1,
        head_dim: 8,
        layers: 2,
        self_attn_every: 2,
        chunk: 6,
        max_action_dim: 8,
        action_dim: 6,
        max_prefix: 13,
    };

    /// The `full` profile: SmolVLA's published action expert (98 M weights), two cameras (177 prefix tokens).
    pub const FULL: Self = Self {
        expert_width: 720,
        expert_mlp: 2048,
        heads: 15,
        kv_heads: 5,
        head_dim: 64,
        layers: 16,
        self_attn_every: 2,
        chunk: 50,
        max_action_dim: 32,
        action_dim: 6,
        max_prefix: 177,
    };

    /// Width of one token's keys (or values).
    pub fn kv_width(&self) -> usize {
        self.kv_heads as usize * self.head_dim as usize
    }

    /// Width of one token's queries.
    pub fn query_width(&self) -> usize {
        self.heads as usize * self.head_dim as usize
    }

    /// Query heads per key and value head.
    pub fn group(&self) -> usize {
        self.heads as usize / self.kv_heads as usize
    }

    /// Whether layer `layer` attends to the action tokens too.
    pub fn is_self_attention(&self, layer: usize) -> bool {
        layer.is_multiple_of(self.self_attn_every as usize)
    }
}

/// Fraction bits of the activations of one layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct LayerScales {
    /// The prefix's keys, as samples hold them.
    pub cache_key: u8,
    /// The prefix's values, as samples hold them.
    pub cache_value: u8,
    /// After the input norm.
    pub normed: u8,
    /// Queries.
    pub query: u8,
    /// Keys that are attended to; those of the cache in a self-attention layer.
    pub key: u8,
    /// Values that are attended to, and the attention's output; those of the cache in a self-attention layer.
    pub value: u8,
    /// Residual stream after attention.
    pub attended: u8,
    /// After the second norm.
    pub mlp_normed: u8,
    /// SwiGLU's gate, before SiLU.
    pub gate: u8,
    /// SwiGLU's other factor.
    pub up: u8,
    /// Their product.
    pub gated: u8,
    /// Residual stream after the MLP.
    pub hidden: u8,
}

/// Everything that an evaluation needs besides weights, sample and draw.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct EvalSpec {
    /// [`EVAL_VERSION`].
    pub version: u16,
    /// Dimensions.
    pub dims: Dims,
    /// Fraction bits of actions, noise, and velocity (at most 12).
    pub action: u8,
    /// Fraction bits of the embedded action and the time embedding (at most 14).
    pub embedding: u8,
    /// Fraction bits of the time MLP before SiLU.
    pub time_hidden: u8,
    /// Fraction bits of the time MLP after SiLU.
    pub time_activation: u8,
    /// Fraction bits of the residual stream that enters layer 0.
    pub hidden: u8,
    /// One per layer.
    pub layers: Vec<LayerScales>,
    /// Fraction bits after the final norm.
    pub final_normed: u8,
    /// `1 / period` for each period of the time embedding, in 2^-32 turns per unit of flow time; `expert_width / 2`.
    pub time_frequencies: Vec<u64>,
    /// RoPE's frequencies in 2^-32 turns per position; `head_dim / 2`.
    pub rope_frequencies: Vec<u32>,
}

/// Why a specification is not valid.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SpecError {
    /// The version is another than this program's.
    #[error(
        "the evaluation specification has version {0}; this program evaluates version {EVAL_VERSION}"
    )]
    Version(u16),
    /// A dimension out of bounds.
    #[error("dimension {name} is {value}; it must be {least} to {most}")]
    Dimension {
        /// Which.
        name: &'static str,
        /// Its value.
        value: u32,
        /// Least allowed.
        least: u32,
        /// Most allowed.
        most: u32,
    },
    /// Two dimensions contradict each other.
    #[error("dimensions disagree: {0}")]
    Inconsistent(&'static str),
    /// Fraction bits out of bounds.
    #[error("scale {name} has {bits} fraction bits; it must have {least} to {most}")]
    Scale {
        /// Which.
        name: &'static str,
        /// Its fraction bits.
        bits: u8,
        /// Least allowed.
        least: u8,
        /// Most allowed.
        most: u8,
    },
    /// A list of the wrong length.
    #[error("{name} has {found} entries; with these dimensions it must have {expected}")]
    Length {
        /// Which list.
        name: &'static str,
        /// Entries needed.
        expected: usize,
        /// Entries there.
        found: usize,
    },
    /// The bytes do not encode a specification.
    #[error("the bytes do not encode an evaluation specification")]
    Encoding,
}

impl EvalSpec {
    /// The specification of the `micro` profile.
    pub fn micro() -> Self {
        Self::new(Dims::MICRO)
    }

    /// Returns a specification for `dims` with default scales, which leave room for activations about ten times those of a
    /// freshly trained model. It uses only exactly specified arithmetic, so that all machines agree on its digest.
    pub fn new(dims: Dims) -> Self {
        // Normed values reach √width times the gain; leave a factor of 4 for the gain.
        let normed = 13u32.saturating_sub(dims.expert_width.max(1).ilog2().div_ceil(2)) as u8;
        let layer = LayerScales {
            cache_key: 10,
            cache_value: 10,
            normed,
            query: 10,
            key: 10,
            value: 10,
            attended: 10,
            mlp_normed: normed,
            gate: 10,
            up: 10,
            gated: 9,
            hidden: 10,
        };
        Self {
            version: EVAL_VERSION,
            dims,
            action: 11,
            embedding: 11,
            time_hidden: 10,
            time_activation: 11,
            hidden: 10,
            layers: vec![layer; dims.layers.min(MAX_LAYERS) as usize],
            final_normed: normed,
            time_frequencies: frequencies::time(dims.expert_width.min(MAX_DIM) / 2),
            rope_frequencies: frequencies::rope(dims.head_dim.min(MAX_DIM) / 2),
        }
    }

    /// Digest of the specification: the claim's `evaluation`.
    pub fn digest(&self) -> Digest {
        tagged_sha256("zk0/eval-spec/v2", &[&self.encode()])
    }

    /// The canonical (borsh) encoding.
    pub fn encode(&self) -> Vec<u8> {
        borsh::to_vec(self).unwrap_or_default() // writing to memory does not fail
    }

    /// Reads an encoding and validates it.
    pub fn decode(bytes: &[u8]) -> Result<Self, SpecError> {
        let spec: Self = borsh::from_slice(bytes).map_err(|_| SpecError::Encoding)?;
        spec.validate()?;
        Ok(spec)
    }

    /// Checks every limit that the evaluation relies on: no sum below overflows an int64, no buffer is larger than the
    /// weights or samples given, no shift is out of range.
    pub fn validate(&self) -> Result<(), SpecError> {
        if self.version != EVAL_VERSION {
            return Err(SpecError::Version(self.version));
        }
        self.dims.validate()?;
        scale("action", self.action, 1, 12)?;
        // A sine of 1 must fit an int16.
        scale("embedding", self.embedding, 0, 14)?;
        scale("time_hidden", self.time_hidden, 6, 10)?;
        scale("time_activation", self.time_activation, 0, 15)?;
        scale("hidden", self.hidden, 0, 15)?;
        scale("final_normed", self.final_normed, 0, 15)?;
        length("layers", self.layers.len(), self.dims.layers as usize)?;
        length(
            "time_frequencies",
            self.time_frequencies.len(),
            self.dims.expert_width as usize / 2,
        )?;
        length(
            "rope_frequencies",
            self.rope_frequencies.len(),
            self.dims.head_dim as usize / 2,
        )?;
        if self
            .time_frequencies
            .iter()
            .any(|&frequency| frequency >> 47 != 0)
        {
            return Err(SpecError::Inconsistent(
                "a time frequency is above 2^15 turns",
            ));
        }
        for (index, layer) in self.layers.iter().enumerate() {
            layer.validate()?;
            if self.dims.is_self_attention(index)
                && (layer.key != layer.cache_key || layer.value != layer.cache_value)
            {
                return Err(SpecError::Inconsistent(
                    "a self-attention layer's keys and values must have the scale of the cache",
                ));
            }
        }
        Ok(())
    }
}

/// Most values in a row that a matrix multiplies: with more, a shifted sum could leave int64 (see [`crate::model::linear`]). The time MLP takes rows of
/// twice the expert's width.
const MAX_COLUMNS: usize = MAX_DIM as usize;
const MAX_DIM: u32 = 1 << 14;
const MAX_LAYERS: u32 = 256;

impl Dims {
    fn validate(&self) -> Result<(), SpecError> {
        for (name, value, most) in [
            ("expert_width", self.expert_width, MAX_DIM / 2),
            ("expert_mlp", self.expert_mlp, MAX_DIM),
            ("heads", self.heads, 256),
            ("kv_heads", self.kv_heads, 256),
            ("head_dim", self.head_dim, 256),
            ("layers", self.layers, MAX_LAYERS),
            ("self_attn_every", self.self_attn_every, MAX_LAYERS),
            ("chunk", self.chunk, 1024),
            ("max_action_dim", self.max_action_dim, 256),
            ("action_dim", self.action_dim, 256),
            ("max_prefix", self.max_prefix, 4096),
        ] {
            if value == 0 || value > most {
                let least = 1;
                return Err(SpecError::Dimension {
                    name,
                    value,
                    least,
                    most,
                });
            }
        }
        for (wrong, why) in [
            (!self.expert_width.is_multiple_of(2), "expert_width is odd"),
            (!self.head_dim.is_multiple_of(2), "head_dim is odd"),
            (
                !self.heads.is_multiple_of(self.kv_heads),
                "kv_heads does not divide heads",
            ),
            (
                self.action_dim > self.max_action_dim,
                "action_dim is above max_action_dim",
            ),
            (
                self.query_width() > MAX_COLUMNS,
                "heads times head_dim is above 16384",
            ),
        ] {
            if wrong {
                return Err(SpecError::Inconsistent(why));
            }
        }
        Ok(())
    }
}

impl LayerScales {
    fn validate(&self) -> Result<(), SpecError> {
        scale("cache_key", self.cache_key, 0, 15)?;
        scale("cache_value", self.cache_value, 0, 15)?;
        scale("normed", self.normed, 0, 15)?;
        scale("query", self.query, 0, 15)?;
        scale("key", self.key, 0, 15)?;
        scale("value", self.value, 0, 15)?;
        scale("attended", self.attended, 0, 15)?;
        scale("mlp_normed", self.mlp_normed, 0, 15)?;
        scale("gate", self.gate, 6, 10)?;
        scale("up", self.up, 0, 15)?;
        scale("gated", self.gated, 0, 15)?;
        scale("layer hidden", self.hidden, 0, 15)
    }
}

fn scale(name: &'static str, bits: u8, least: u8, most: u8) -> Result<(), SpecError> {
    if (least..=most).contains(&bits) {
        return Ok(());
    }
    Err(SpecError::Scale {
        name,
        bits,
        least,
        most,
    })
}

fn length(name: &'static str, found: usize, expected: usize) -> Result<(), SpecError> {
    if found == expected {
        return Ok(());
    }
    Err(SpecError::Length {
        name,
        expected,
        found,
    })
}

/// Computes frequencies with IEEE additions, multiplications and divisions only, which every machine rounds alike.
mod frequencies {
    use alloc::vec::Vec;
    use core::f64::consts::LOG2_10;

    const LN_2: f64 = core::f64::consts::LN_2;

    /// Periods are geometric from 0.004 to 4: frequency i is `250 · 1000^(−i/(half − 1))`.
    pub fn time(half: u32) -> Vec<u64> {
        let steps = half.saturating_sub(1).max(1) as f64;
        let turns = |index: u32| 250.0 * exp2(-(index as f64 / steps) * 3.0 * LOG2_10);
        (0..half)
            .map(|index| (turns(index) * 4294967296.0 + 0.5) as u64)
            .collect()
    }

    /// Frequency i is `10000^(−i/half)` radians per position.
    pub fn rope(half: u32) -> Vec<u32> {
        let radians = |index: u32| exp2(-(index as f64 / half as f64) * 4.0 * LOG2_10);
        let turns = |index: u32| radians(index) / core::f64::consts::TAU;
        (0..half)
            .map(|index| (turns(index) * 4294967296.0 + 0.5) as u32)
            .collect()
    }

    /// 2^x for −64 < x ≤ 0, by halving and the series of e^y.
    fn exp2(x: f64) -> f64 {
        let whole = (-x) as u32;
        let y = (x + whole as f64) * LN_2;
        let (mut term, mut sum) = (1.0, 1.0);
        for n in 1..=24 {
            term *= y / n as f64;
            sum += term;
        }
        sum / (1u64 << whole.min(63)) as f64
    }
}
