//! Attention of every token to every token, without mask or gradient: the vision tower's, which is frozen.
//!
//! Scores are made, used and forgotten a block of queries at a time, so that they stay in the cache (the idea of Dao et al.,
//! FlashAttention, 2022; keys are few enough here that their rows need not be split).

use candle_core::{CpuStorage, CustomOp3, Layout, Result, Shape, Tensor, D};
use rayon::prelude::*;

use super::matrix::{product, Into, Matrix, Threads};
use super::softmax::exponentials;
use super::vector::vectorised;
use super::{serve, values};

/// Queries a block: with 1024 keys their scores take 256 KiB.
const BLOCK: usize = 64;

/// `softmax(q·kᵀ / sqrt(dim))·v` for each of `heads` heads, side by side in the last dimension of q, k and v (B, L, heads * dim).
/// Gives (B, L, heads * dim). Has no backward pass.
pub fn attend_to_all(q: &Tensor, k: &Tensor, v: &Tensor, heads: usize) -> Result<Tensor> {
    if serve(q) {
        let (q, k, v) = (q.contiguous()?, k.contiguous()?, v.contiguous()?);
        return q.apply_op3_no_bwd(&k, &v, &AttendToAll { heads });
    }
    let (batch, tokens, width) = q.dims3()?;
    let dim = width / heads;
    let by_head = |x: &Tensor| {
        x.reshape((batch, tokens, heads, dim))?
            .transpose(1, 2)?
            .contiguous()
    };
    let scores = (by_head(q)?.matmul(&by_head(k)?.t()?)? * (dim as f64).powf(-0.5))?;
    candle_nn::ops::softmax(&scores, D::Minus1)?
        .matmul(&by_head(v)?)?
        .transpose(1, 2)?
        .reshape((batch, tokens, width))
}

struct AttendToAll {
    heads: usize,
}

impl CustomOp3 for AttendToAll {
    fn name(&self) -> &'static str {
        "attend-to-all"
    }

    fn cpu_fwd(
        &self,
        q: &CpuStorage,
        q_layout: &Layout,
        k: &CpuStorage,
        k_layout: &Layout,
        v: &CpuStorage,
        v_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (batch, tokens, width) = q_layout.shape().dims3()?;
        for layout in [k_layout, v_layout] {
            if layout.shape() != q_layout.shape() || width % self.heads.max(1) != 0 {
                candle_core::bail!(
                    "queries {:?}, keys or values {:?}, {} heads",
                    q_layout.shape(),
                    layout.shape(),
                    self.heads
                );
            }
        }
        let dim = width / self.heads.max(1);
        let scale = (dim as f32).powf(-0.5);
        let (q, k, v) = (
            values(q, q_layout)?,
            values(k, k_layout)?,
            values(v, v_layout)?,
        );
        let mut out = vec![0.0f32; batch * tokens * width];
        // A block never reaches into another sample: samples are divided first.
        let samples = out.par_chunks_mut((tokens * width).max(1)).enumerate();
        let blocks = samples.flat_map(|(sample, out)| {
            let blocks = out.par_chunks_mut((BLOCK * width).max(1)).enumerate();
            blocks.map(move |(block, out)| (sample * tokens, sample * tokens + block * BLOCK, out))
        });
        blocks.for_each(|(first_key, first_query, out)| {
            let queries = out.len() / width;
            let mut scores = vec![0.0f32; queries * tokens];
            for head in 0..self.heads {
                let column = head * dim;
                let queries_of =
                    Matrix::strided(&q[first_query * width + column..], queries, dim, width);
                let keys_of = Matrix::strided(&k[first_key * width + column..], tokens, dim, width);
                let values_of =
                    Matrix::strided(&v[first_key * width + column..], tokens, dim, width);
                product(
                    queries_of,
                    keys_of.transposed(),
                    scale,
                    &mut scores,
                    tokens,
                    Into::Replace,
                    Threads::One,
                );
                let mut totals = [0.0f32; BLOCK];
                vectorised(|| {
                    for (row, total) in scores.chunks_exact_mut(tokens).zip(&mut totals) {
                        *total = exponentials(row);
                    }
                });
                let out = &mut out[column..];
                product(
                    Matrix::new(&scores, queries, tokens),
                    values_of,
                    1.0,
                    out,
                    width,
                    Into::Replace,
                    Threads::One,
                );
                for (row, total) in out.chunks_mut(width).zip(&totals) {
                    let factor = 1.0 / total;
                    row[..dim].iter_mut().for_each(|value| *value *= factor);
                }
            }
        });
        Ok((CpuStorage::F32(out), q_layout.shape().clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::Device;

    #[test]
    fn blocks_give_what_whole_matrices_give() {
        // 150 tokens: two whole blocks and a part of one.
        let (batch, tokens, heads, dim) = (2, 150, 3, 5);
        let tensor = |step: f32| {
            let count = batch * tokens * heads * dim;
            let values = (0..count).map(|i| 3.0 * (i as f32 * step).sin()).collect();
            Tensor::from_vec(values, (batch, tokens, heads * dim), &Device::Cpu).unwrap()
        };
        let (q, k, v) = (tensor(0.37), tensor(0.71), tensor(1.3));
        let ours = attend_to_all(&q, &k, &v, heads).unwrap();
        // In double precision the general path is taken.
        let double = |x: &Tensor| x.to_dtype(candle_core::DType::F64).unwrap();
        let theirs = attend_to_all(&double(&q), &double(&k), &double(&v), heads).unwrap();
        let difference = (double(&ours) - theirs).unwrap().abs().unwrap();
        let largest: f64 = difference
            .flatten_all()
            .unwrap()
            .max(0)
            .unwrap()
            .to_scalar()
            .unwrap();
        assert!(largest < 1e-5, "{largest}");
    }
}
