//! The rotary embedding's rotation, over halves.

use candle_core::{Result, Tensor, D};
use pulp::{Arch, Simd};

use crate::policy::model::kernels::dispatch::{in_chunks, serve};
use crate::policy::model::kernels::operation::{
    CpuOperation, CpuValues, Gradients, Kernel, KernelOutput,
};

/// Rotates the halves of the last dimension of x (B, L, heads, dim): `(a cos - b sin, b cos + a sin)`, in the angles' type. Sines and
/// cosines are (B, L, 1, dim / 2) and get no gradient.
pub fn rotate(x: &Tensor, sin: &Tensor, cos: &Tensor) -> Result<Tensor> {
    if serve(x) {
        return x
            .contiguous()?
            .apply_op3(sin, cos, CpuOperation(Rotate { back: false }));
    }
    let (x, half) = (x.to_dtype(sin.dtype())?, x.dim(D::Minus1)? / 2);
    let (a, b) = (
        x.narrow(D::Minus1, 0, half)?,
        x.narrow(D::Minus1, half, half)?,
    );
    let first = (a.broadcast_mul(cos)? - b.broadcast_mul(sin)?)?;
    let second = (b.broadcast_mul(cos)? + a.broadcast_mul(sin)?)?;
    Tensor::cat(&[first, second], D::Minus1)
}

struct Rotate {
    /// By the negative angles, for gradients.
    back: bool,
}

impl Kernel<3> for Rotate {
    const NAME: &'static str = "rotate";

    fn forward(&self, [x, sin, cos]: [CpuValues; 3]) -> KernelOutput {
        let (batch, tokens, heads, dim) = x.shape.dims4()?;
        let half = dim / 2;
        let angles = (batch, tokens, 1, half);
        if sin.shape.dims4()? != angles || cos.shape.dims4()? != angles || half == 0 {
            candle_core::bail!("cannot rotate {:?} by angles {:?}", x.shape, sin.shape);
        }
        let mut out = x.to_vec();
        let sign = if self.back { -1.0 } else { 1.0 };
        in_chunks(&mut out, heads * dim, 4, |at, token| {
            let angles = at * half..(at + 1) * half;
            rotate_heads(token, &sin[angles.clone()], &cos[angles], sign)
        });
        Ok((out, x.shape.clone()))
    }

    fn backward(&self, [_, sin, cos]: [&Tensor; 3], _: &Tensor, grad: &Tensor) -> Gradients<3> {
        let back = CpuOperation(Rotate { back: !self.back });
        let of_x = grad.contiguous()?.apply_op3_no_bwd(sin, cos, &back)?;
        Ok([Some(of_x), None, None])
    }
}

#[pulp::with_simd(rotate_heads = Arch::new())]
#[inline(always)]
fn rotate_heads_with<S: Simd>(_: S, token: &mut [f32], sin: &[f32], cos: &[f32], sign: f32) {
    for head in token.chunks_exact_mut(2 * sin.len()) {
        let (a, b) = head.split_at_mut(sin.len());
        for (((a, b), sin), cos) in a.iter_mut().zip(b).zip(sin).zip(cos) {
            let sin = sign * sin;
            (*a, *b) = (*a * cos - *b * sin, *b * cos + *a * sin);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{Device, Var};

    #[test]
    fn rotating_keeps_lengths_and_its_gradient_rotates_back() {
        let (batch, tokens, heads, dim) = (2, 3, 2, 6);
        let count = batch * tokens * heads * dim;
        let x: Vec<f32> = (0..count).map(|i| (i as f32 * 0.7).sin()).collect();
        let x = Tensor::from_vec(x, (batch, tokens, heads, dim), &Device::Cpu).unwrap();
        let angles: Vec<f32> = (0..batch * tokens * dim / 2)
            .map(|i| i as f32 * 0.3)
            .collect();
        let angles = Tensor::from_vec(angles, (batch, tokens, 1, dim / 2), &Device::Cpu).unwrap();
        let (sin, cos) = (angles.sin().unwrap(), angles.cos().unwrap());
        let variable = Var::from_tensor(&x).unwrap();
        let rotated = rotate(&variable, &sin, &cos).unwrap();
        let list = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        let (before, after) = (list(&x), list(&rotated));
        // The second token's first head, by hand.
        for (i, angle) in [0.9f32, 1.2, 1.5].into_iter().enumerate() {
            let at = heads * dim + i;
            let (a, b) = (before[at], before[at + 3]);
            assert!((after[at] - (a * angle.cos() - b * angle.sin())).abs() < 1e-6);
            assert!((after[at + 3] - (b * angle.cos() + a * angle.sin())).abs() < 1e-6);
        }
        // Half the squared length has the vector as gradient.
        let loss = (rotated.sqr().unwrap().sum_all().unwrap() * 0.5).unwrap();
        let gradient = list(loss.backward().unwrap().get(&variable).unwrap());
        for (found, x) in gradient.iter().zip(&before) {
            assert!((found - x).abs() < 1e-6);
        }
    }
}
