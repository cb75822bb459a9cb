//! Places in the evaluation, and what can go wrong there.

use crate::model::spec::SpecError;
use core::fmt;

/// A place in the evaluation where a value must fit: int16, or int32 for a product's sum.
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
    /// Products of a layer's queries and keys, which are int64. They fit whatever they are; scales are chosen so that they would fit int32.
    Scores(usize),
    /// Attention output of a layer.
    Attention(usize),
    /// `o_proj` of a layer.
    AttentionOut(usize),
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
    /// `down_proj` of a layer.
    Down(usize),
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
            Self::Scores(layer) => write!(f, "layer {layer} attention scores"),
            Self::Attention(layer) => write!(f, "layer {layer} attention output"),
            Self::AttentionOut(layer) => write!(f, "layer {layer} o_proj"),
            Self::Attended(layer) => write!(f, "layer {layer} residual after o_proj"),
            Self::MlpNorm(layer) => write!(f, "layer {layer} post_attention_layernorm"),
            Self::Gate(layer) => write!(f, "layer {layer} gate_proj"),
            Self::Up(layer) => write!(f, "layer {layer} up_proj"),
            Self::Gated(layer) => write!(f, "layer {layer} gated MLP"),
            Self::Down(layer) => write!(f, "layer {layer} down_proj"),
            Self::MlpOut(layer) => write!(f, "layer {layer} residual after down_proj"),
            Self::FinalNorm => write!(f, "final norm"),
            Self::Velocity => write!(f, "velocity (action_out_proj)"),
        }
    }
}

/// What becomes of a value that does not fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overflow {
    /// The evaluation fails. An update has to fit.
    Refused,
    /// It becomes the nearest value that fits. So no base keeps others from making claims.
    Saturated,
}

/// How values are narrowed at a place.
#[derive(Clone, Copy, Debug)]
pub struct Narrowing {
    /// The place.
    pub site: Site,
    /// What becomes of a value that does not fit.
    pub overflow: Overflow,
}

impl Narrowing {
    /// Fails with a value that does not fit, if that is refused.
    #[cold]
    #[inline(never)]
    pub(crate) fn overflown(self, value: i64) -> Result<(), EvalError> {
        let Self { site, overflow } = self;
        match overflow {
            Overflow::Refused => Err(EvalError::OutOfRange { site, value }),
            Overflow::Saturated => Ok(()),
        }
    }
}

/// Why an evaluation fails.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EvalError {
    /// A value does not fit at the specification's scale.
    #[error("{site}: {value} does not fit at the round's scale")]
    OutOfRange {
        /// Where.
        site: Site,
        /// The value.
        value: i64,
    },
    /// Weights, sample or draw were made for other dimensions.
    #[error("{0} does not have the dimensions of the specification")]
    Dimensions(&'static str),
    /// The specification is not valid.
    #[error(transparent)]
    Spec(#[from] SpecError),
}
