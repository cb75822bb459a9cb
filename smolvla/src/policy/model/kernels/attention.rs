//! Attention of every token to every token, without mask or gradient: the frozen vision tower's. Blocks of queries keep the scores in the
//! processor's cache (the idea of Dao et al., FlashAttention, 2022; keys are few, so rows are not split).

use candle_core::{Result, Shape, Tensor, D};
use pulp::{Arch, Simd};
use rayon::prelude::*;

use crate::policy::model::kernels::dispatch::{serve, widened};
use crate::policy::model::kernels::matmul::matmul;
use crate::policy::model::kernels::matrix::{product, Into, StridedMatrix, Threads};
use crate::policy::model::kernels::operation::{CpuOperation, CpuValues, Kernel, KernelOutput};
use crate::policy::model::kernels::softmax::exponentials;

/// Queries per block: with 1024 keys, their scores take 1 MiB.
const BLOCK: usize = 256;

/// `softmax(q·kᵀ / sqrt(dim))·v` for each of `heads` heads: (B, L, heads * dim), without a backward pass. `qkv` (B, L, 3 * heads * dim) has
/// queries, keys and values side by side, each with its heads side by side.
pub fn attend_to_all(qkv: &Tensor, heads: usize) -> Result<Tensor> {
    if serve(qkv) {
        return qkv
            .contiguous()?
            .apply_op1_no_bwd(&CpuOperation(AttendToAll { heads }));
    }
    let (batch, tokens, width) = qkv.dims3()?;
    let (width, dim) = (width / 3, width / 3 / heads);
    let by_head = |part: usize| {
        qkv.narrow(2, part * width, width)?
            .reshape((batch, tokens, heads, dim))?
            .transpose(1, 2)?
            .contiguous()
    };
    let scores = widened(&matmul(&by_head(0)?, &by_head(1)?.t()?)?)?;
    let scores = (scores * (dim as f64).powf(-0.5))?;
    let weights = candle_nn::ops::softmax(&scores, D::Minus1)?.to_dtype(qkv.dtype())?;
    matmul(&weights, &by_head(2)?)?
        .transpose(1, 2)?
        .reshape((batch, tokens, width))
}

struct AttendToAll {
    heads: usize,
}

impl Kernel<1> for AttendToAll {
    const NAME: &'static str = "attend-to-all";

    fn forward(&self, [qkv]: [CpuValues; 1]) -> KernelOutput {
        let (batch, tokens, stride) = qkv.shape.dims3()?;
        let heads = self.heads.max(1);
        if stride % (3 * heads) != 0 {
            candle_core::bail!("{stride} values for queries, keys and values of {heads} heads");
        }
        let width = stride / 3;
        let dim = width / heads;
        let scale = (dim as f32).powf(-0.5);
        let mut out = vec![0.0f32; batch * tokens * width];
        // No block spans two samples.
        let samples = out.par_chunks_mut((tokens * width).max(1)).enumerate();
        let blocks = samples.flat_map(|(sample, out)| {
            let blocks = out.par_chunks_mut((BLOCK * width).max(1)).enumerate();
            blocks.map(move |(block, out)| (sample * tokens, sample * tokens + block * BLOCK, out))
        });
        blocks.for_each(|(first_key, first_query, out)| {
            let queries = out.len() / width;
            let mut scores = vec![0.0f32; queries * tokens];
            for column in (0..width).step_by(dim.max(1)) {
                let of = |token: usize, part: usize, count: usize| {
                    let from = token * stride + part * width + column;
                    StridedMatrix::strided(&qkv[from..], count, dim, stride)
                };
                product(
                    of(first_query, 0, queries),
                    of(first_key, 1, tokens).transposed(),
                    scale,
                    &mut scores,
                    tokens,
                    Into::Replace,
                    Threads::One,
                );
                let mut totals = [0.0f32; BLOCK];
                exponentiate(&mut scores, tokens, &mut totals);
                let out = &mut out[column..];
                product(
                    StridedMatrix::new(&scores, queries, tokens),
                    of(first_key, 2, tokens),
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
        Ok((out, Shape::from((batch, tokens, width))))
    }
}

/// Turns rows of `tokens` scores into [`exponentials`] and their sums.
#[pulp::with_simd(exponentiate = Arch::new())]
#[inline(always)]
fn exponentiate_with<S: Simd>(_: S, scores: &mut [f32], tokens: usize, totals: &mut [f32]) {
    for (row, total) in scores.chunks_exact_mut(tokens).zip(totals) {
        *total = exponentials(row);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::Device;

    #[test]
    fn blocks_give_what_whole_matrices_give() {
        let (batch, tokens, heads, dim) = (2, 600, 3, 5);
        let count = batch * tokens * 3 * heads * dim;
        let values = (0..count).map(|i| 3.0 * (i as f32 * 0.37).sin()).collect();
        let qkv = Tensor::from_vec(values, (batch, tokens, 3 * heads * dim), &Device::Cpu).unwrap();
        let ours = attend_to_all(&qkv, heads).unwrap();
        let double = |x: &Tensor| x.to_dtype(candle_core::DType::F64).unwrap();
        let theirs = attend_to_all(&double(&qkv), heads).unwrap();
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
