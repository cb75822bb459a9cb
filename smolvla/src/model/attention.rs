//! Masked softmax attention with grouped key/value heads.

use candle_core::{Device, Tensor};

use super::kernels::softmax::masked_softmax;
use crate::error::Result;

/// What each query may see, as numbers added to the scores: 0 where it may, the lowest `f32` where not.
///
/// A row that may see nothing (a padded token) then attends evenly to everything, as in the reference.
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

/// Attention of queries (B, Q, heads, dim) to keys and values (B, K, kv_heads, dim), giving (B, Q, heads * dim).
/// Query head `h` reads key/value head `h / (heads / kv_heads)`.
pub fn attend(queries: &Tensor, keys: &Tensor, values: &Tensor, mask: &Mask) -> Result<Tensor> {
    mix(&products(queries, keys)?, values, mask)
}

/// Products of queries (B, Q, heads, dim) and keys (B, K, kv_heads, dim), neither scaled nor masked: (B, heads, Q, K).
pub fn products(queries: &Tensor, keys: &Tensor) -> Result<Tensor> {
    let (batch, count, heads, dim) = queries.dims4()?;
    let (_, keys_count, kv_heads, _) = keys.dims4()?;
    // The queries that share a key head stand below one another, so that no key is copied for them.
    let q = queries.transpose(1, 2)?.contiguous()?;
    let q = q.reshape((batch * kv_heads, heads / kv_heads * count, dim))?;
    let scores = q.matmul(&by_head(keys)?.t()?)?;
    Ok(scores.reshape((batch, heads, count, keys_count))?)
}

/// The second half of [`attend`]: from [`products`] and values (B, K, kv_heads, dim) to (B, Q, heads * dim).
pub fn mix(products: &Tensor, values: &Tensor, mask: &Mask) -> Result<Tensor> {
    let (batch, heads, count, keys_count) = products.dims4()?;
    let (kv_heads, dim) = (values.dim(2)?, values.dim(3)?);
    let weights = masked_softmax(products, &mask.0, (dim as f64).powf(-0.5))?;
    let weights = weights.reshape((batch * kv_heads, heads / kv_heads * count, keys_count))?;
    Ok(weights
        .matmul(&by_head(values)?)?
        .reshape((batch, heads, count, dim))?
        .transpose(1, 2)?
        .reshape((batch, count, heads * dim))?)
}

/// (B, K, kv_heads, dim) as (B * kv_heads, K, dim).
fn by_head(x: &Tensor) -> Result<Tensor> {
    let (batch, count, heads, dim) = x.dims4()?;
    let x = x.transpose(1, 2)?.contiguous()?;
    Ok(x.reshape((batch * heads, count, dim))?)
}
