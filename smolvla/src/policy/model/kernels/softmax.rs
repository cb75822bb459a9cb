//! Softmax of attention scores, scaled and masked in one pass.

use candle_core::{Result, Tensor, D};
use pulp::{Arch, Simd};

use crate::policy::model::kernels::dispatch::{in_chunks, serve};
use crate::policy::model::kernels::operation::{
    CpuOperation, CpuValues, Gradients, Kernel, KernelOutput,
};
use crate::policy::model::kernels::vector::{exp, sum};

/// `softmax(scale * scores + mask)` over the last dimension, for scores (B, heads, Q, K) and a mask (B, 1, Q, K) without a gradient.
pub fn masked_softmax(scores: &Tensor, mask: &Tensor, scale: f64) -> Result<Tensor> {
    if serve(scores) {
        let scale = scale as f32;
        return scores
            .contiguous()?
            .apply_op2(&mask.contiguous()?, CpuOperation(MaskedSoftmax { scale }));
    }
    let scores = (scores * scale)?.broadcast_add(mask)?;
    // Only against overflow, so without a gradient.
    let shifted = scores
        .broadcast_sub(&scores.max_keepdim(D::Minus1)?.detach())?
        .exp()?;
    shifted.broadcast_div(&shifted.sum_keepdim(D::Minus1)?)
}

struct MaskedSoftmax {
    scale: f32,
}

impl Kernel<2> for MaskedSoftmax {
    const NAME: &'static str = "masked-softmax";

    fn forward(&self, [scores, mask]: [CpuValues; 2]) -> KernelOutput {
        let (batch, heads, queries, keys) = scores.shape.dims4()?;
        if mask.shape.dims4()? != (batch, 1, queries, keys) {
            candle_core::bail!("scores {:?} and mask {:?}", scores.shape, mask.shape);
        }
        let mut out = scores.to_vec();
        let scale = self.scale;
        let plane = (queries * keys).max(1);
        in_chunks(&mut out, plane, 16, |at, scores| {
            let mask = &mask[at / heads * plane..][..scores.len()];
            softmax_rows(scores, mask, keys.max(1), scale)
        });
        Ok((out, scores.shape.clone()))
    }

    fn backward(&self, _: [&Tensor; 2], out: &Tensor, grad: &Tensor) -> Gradients<2> {
        let scale = self.scale;
        let grad = grad.contiguous()?;
        let of_scores = out.apply_op2_no_bwd(&grad, &CpuOperation(SoftmaxBackward { scale }))?;
        Ok([Some(of_scores), None])
    }
}

/// `scale * p * (g - Σ g p)` row by row, for probabilities p and their gradient g.
struct SoftmaxBackward {
    scale: f32,
}

impl Kernel<2> for SoftmaxBackward {
    const NAME: &'static str = "masked-softmax-backward";

    fn forward(&self, [out, grad]: [CpuValues; 2]) -> KernelOutput {
        let (_, _, queries, keys) = out.shape.dims4()?;
        let mut result = grad.to_vec();
        let (scale, keys) = (self.scale, keys.max(1));
        let plane = (queries * keys).max(1);
        if out.len() != result.len() {
            candle_core::bail!("a gradient {:?}", grad.shape);
        }
        in_chunks(&mut result, plane, 6, |at, grad| {
            gradient_rows(grad, &out[at * plane..][..grad.len()], keys, scale)
        });
        Ok((result, grad.shape.clone()))
    }
}

/// The softmax of `scale * scores + mask` in place.
#[pulp::with_simd(softmax_rows = Arch::new())]
#[inline(always)]
fn softmax_rows_with<S: Simd>(_: S, scores: &mut [f32], mask: &[f32], keys: usize, scale: f32) {
    for (row, mask) in scores.chunks_exact_mut(keys).zip(mask.chunks_exact(keys)) {
        for (value, mask) in row.iter_mut().zip(mask) {
            *value = *value * scale + mask;
        }
        let factor = 1.0 / exponentials(row);
        for value in row {
            *value *= factor;
        }
    }
}

#[pulp::with_simd(gradient_rows = Arch::new())]
#[inline(always)]
fn gradient_rows_with<S: Simd>(_: S, grad: &mut [f32], p: &[f32], keys: usize, scale: f32) {
    for (grad, p) in grad.chunks_exact_mut(keys).zip(p.chunks_exact(keys)) {
        let n = grad.len().min(p.len());
        let (g, p) = (&mut grad[..n], &p[..n]);
        let mean = sum(n, |i| g[i] * p[i]);
        for (g, p) in g.iter_mut().zip(p) {
            *g = scale * p * (*g - mean);
        }
    }
}

/// e^(x − largest x) in place; returns the sum.
#[inline(always)]
pub(super) fn exponentials(row: &mut [f32]) -> f32 {
    const LANES: usize = 16;
    let largest = largest(row);
    let mut lanes = [0.0f32; LANES];
    let mut chunks = row.chunks_exact_mut(LANES);
    for chunk in &mut chunks {
        for (lane, value) in lanes.iter_mut().zip(chunk) {
            *value = exp(*value - largest);
            *lane += *value;
        }
    }
    for (lane, value) in lanes.iter_mut().zip(chunks.into_remainder()) {
        *value = exp(*value - largest);
        *lane += *value;
    }
    sum(LANES, |i| lanes[i])
}

#[inline(always)]
fn largest(row: &[f32]) -> f32 {
    const LANES: usize = 16;
    let mut lanes = [f32::MIN; LANES];
    let chunks = row.chunks_exact(LANES);
    let rest = chunks.remainder();
    for chunk in chunks {
        for (lane, value) in lanes.iter_mut().zip(chunk) {
            *lane = if *value > *lane { *value } else { *lane };
        }
    }
    let all = lanes.iter().chain(rest);
    all.fold(f32::MIN, |most, value| most.max(*value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{Device, Var};

    #[test]
    fn values_and_gradients_are_candles() {
        let (batch, heads, queries, keys) = (2, 3, 4, 21);
        let count = batch * heads * queries * keys;
        let scores: Vec<f32> = (0..count).map(|i| 8.0 * (i as f32 * 0.37).sin()).collect();
        let mask: Vec<f32> = (0..batch * queries * keys)
            .map(|i| match (i / keys % queries, i % keys) {
                (3, _) => f32::MIN,
                (q, k) if k > q + 9 => f32::MIN,
                _ => 0.0,
            })
            .collect();
        let scores = Tensor::from_vec(scores, (batch, heads, queries, keys), &Device::Cpu).unwrap();
        let mask = Tensor::from_vec(mask, (batch, 1, queries, keys), &Device::Cpu).unwrap();
        let variable = Var::from_tensor(&scores).unwrap();
        let ours = masked_softmax(&variable, &mask, 0.3).unwrap();
        let masked = (variable.as_tensor() * 0.3)
            .unwrap()
            .broadcast_add(&mask)
            .unwrap();
        let theirs = candle_nn::ops::softmax(&masked, D::Minus1).unwrap();
        let distance = |a: &Tensor, b: &Tensor| {
            let difference = (a - b).unwrap().abs().unwrap().flatten_all().unwrap();
            difference.max(0).unwrap().to_scalar::<f32>().unwrap()
        };
        assert!(distance(&ours, &theirs) < 1e-6);
        let weighted = |p: &Tensor| {
            (p * &scores)
                .unwrap()
                .sum_all()
                .unwrap()
                .backward()
                .unwrap()
        };
        let (ours, theirs) = (weighted(&ours), weighted(&theirs));
        let of = |gradients: &candle_core::backprop::GradStore| {
            gradients.get(&variable).unwrap().clone()
        };
        assert!(distance(&of(&ours), &of(&theirs)) < 1e-5);
    }
}
