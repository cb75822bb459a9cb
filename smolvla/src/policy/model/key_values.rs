//! The frozen half's result.

use candle_core::Tensor;

/// The frozen half's result for a batch of frames.
#[derive(Clone)]
pub struct PrefixCache {
    /// Per layer (B, P, kv_heads, head_dim), after the rotary embedding.
    pub keys: Vec<Tensor>,
    /// Per layer (B, P, kv_heads, head_dim).
    pub values: Vec<Tensor>,
    /// Which tokens are real: B rows of P. The others are never attended to.
    pub valid: Vec<Vec<bool>>,
}
