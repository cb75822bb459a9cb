//! Masked softmax attention with grouped key/value heads.

use candle_core::{Device, Tensor, D};

use crate::error::Result;

/// What each query may see, as numbers added to the scores: 0 where it may, the lowest `f32` where not. Or nothing, where
/// every query sees everything.
///
/// A row that may see nothing (a padded token) then attends evenly to everything, as in the reference.
pub struct Mask(Option<Tensor>);

impl Mask {
    /// Hides nothing.
    pub fn none() -> Self {
        Self(None)
    }

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
        Ok(Self(Some(Tensor::from_vec(bias, shape, device)?)))
    }
}

/// Attention of queries (B, Q, heads, dim) to keys and values (B, K, kv_heads, dim), giving (B, Q, heads * dim).
/// Query head `h` reads key/value head `h / (heads / kv_heads)`.
pub fn attend(queries: &Tensor, keys: &Tensor, values: &Tensor, mask: &Mask) -> Result<Tensor> {
    mix(&products(queries, keys)?, values, mask)
}

/// Products of queries (B, Q, heads, dim) and keys (B, K, kv_heads, dim), neither scaled nor masked: (B, heads, Q, K).
pub fn products(queries: &Tensor, keys: &Tensor) -> Result<Tensor> {
    let groups = queries.dim(2)? / keys.dim(2)?;
    let q = queries.transpose(1, 2)?.contiguous()?;
    let k = repeat(keys, groups)?.permute((0, 2, 3, 1))?.contiguous()?;
    Ok(q.matmul(&k)?)
}

/// The second half of [`attend`]: from [`products`] and values (B, K, kv_heads, dim) to (B, Q, heads * dim).
pub fn mix(products: &Tensor, values: &Tensor, mask: &Mask) -> Result<Tensor> {
    let (batch, heads, count, _) = products.dims4()?;
    let dim = values.dim(3)?;
    let v = repeat(values, heads / values.dim(2)?)?
        .transpose(1, 2)?
        .contiguous()?;
    let scores = (products * (dim as f64).powf(-0.5))?;
    let scores = match &mask.0 {
        Some(bias) => scores.broadcast_add(bias)?,
        None => scores,
    };
    let weights = softmax(&scores)?;
    Ok(weights
        .matmul(&v)?
        .transpose(1, 2)?
        .reshape((batch, count, heads * dim))?)
}

/// (B, K, kv_heads, dim) with every head repeated `groups` times in a row.
fn repeat(x: &Tensor, groups: usize) -> Result<Tensor> {
    if groups == 1 {
        return Ok(x.clone());
    }
    let (batch, count, heads, dim) = x.dims4()?;
    let wide = x
        .unsqueeze(3)?
        .broadcast_as((batch, count, heads, groups, dim))?;
    Ok(wide.reshape((batch, count, heads * groups, dim))?)
}

/// Softmax over the last dimension. The maximum only guards against overflow, so it carries no gradient.
fn softmax(x: &Tensor) -> Result<Tensor> {
    let shifted = x
        .broadcast_sub(&x.max_keepdim(D::Minus1)?.detach())?
        .exp()?;
    Ok(shifted.broadcast_div(&shifted.sum_keepdim(D::Minus1)?)?)
}
