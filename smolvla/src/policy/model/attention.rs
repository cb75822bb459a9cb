//! Masked softmax attention with grouped key/value heads.

use candle_core::{Device, Tensor};

use crate::error::Result;
use crate::policy::model::kernels::heads::{queries_by_keys, weights_by_values};
use crate::policy::model::kernels::softmax::masked_softmax;

/// What each query may see, as addends to scores: 0, or the lowest `f32` for hidden keys. A row that may see nothing (a padded token)
/// attends evenly to everything, as in the reference.
pub struct Mask(Tensor);

impl Mask {
    /// From `allowed(sample, query, key)`.
    pub fn new(
        (batch, queries, keys): (usize, usize, usize),
        device: &Device,
        allowed: impl Fn(usize, usize, usize) -> bool,
    ) -> Result<Self> {
        let mut bias = Vec::with_capacity(batch * queries * keys);
        for b in 0..batch {
            for q in 0..queries {
                bias.extend((0..keys).map(|k| if allowed(b, q, k) { 0.0 } else { f32::MIN }));
            }
        }
        let shape = (batch, 1, queries, keys);
        Ok(Self(Tensor::from_vec(bias, shape, device)?))
    }
}

/// Attention of queries (B, Q, heads, dim) to keys and values (B, K, kv_heads, dim): (B, Q, heads * dim). Query head `h` reads key/value
/// head `h / (heads / kv_heads)`.
pub fn attend(queries: &Tensor, keys: &Tensor, values: &Tensor, mask: &Mask) -> Result<Tensor> {
    mix(&products(queries, keys)?, values, mask)
}

/// Raw products of queries (B, Q, heads, dim) and keys (B, K, kv_heads, dim): (B, heads, Q, K).
pub fn products(queries: &Tensor, keys: &Tensor) -> Result<Tensor> {
    Ok(queries_by_keys(queries, keys)?)
}

/// The rest of [`attend`]: from [`products`] and values (B, K, kv_heads, dim) to (B, Q, heads * dim).
pub fn mix(products: &Tensor, values: &Tensor, mask: &Mask) -> Result<Tensor> {
    let dim = values.dim(3)?;
    let weights = masked_softmax(products, &mask.0, (dim as f64).powf(-0.5))?;
    let mixed = weights_by_values(&weights, values)?.transpose(1, 2)?;
    Ok(mixed.flatten_from(2)?)
}
