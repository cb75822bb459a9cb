//! RMSNorm (Zhang and Sennrich, 2019), forward and backward row by row.

use candle_core::{CpuStorage, CustomOp2, CustomOp3, Layout, Result, Shape, Tensor, D};
use rayon::prelude::*;

use super::vector::{sum, vectorised};
use super::{serve, values};

/// `x / sqrt(mean(x²) + eps) * gain` over the last dimension; no gradient is computed for a gain that is not a variable.
pub fn rms_norm(x: &Tensor, gain: &Tensor, eps: f64) -> Result<Tensor> {
    if serve(x) {
        let eps = eps as f32;
        return x.contiguous()?.apply_op2(gain, RmsNorm { eps });
    }
    let mean_square = x.sqr()?.mean_keepdim(D::Minus1)?;
    x.broadcast_div(&(mean_square + eps)?.sqrt()?)?
        .broadcast_mul(gain)
}

struct RmsNorm {
    eps: f32,
}

/// `1 / sqrt(mean(x²) + eps)`.
#[inline(always)]
fn inverse_root(x: &[f32], eps: f32) -> f32 {
    let mean_square = sum(x.len(), |i| x[i] * x[i]) / x.len() as f32;
    1.0 / (mean_square + eps).sqrt()
}

impl CustomOp2 for RmsNorm {
    fn name(&self) -> &'static str {
        "rms-norm"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        gain: &CpuStorage,
        gain_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let gain = values(gain, gain_layout)?;
        if x_layout.dims().last() != Some(&gain.len()) || gain.is_empty() {
            candle_core::bail!("a norm of {} values got {:?}", gain.len(), x_layout.shape());
        }
        let mut out = values(x, x_layout)?.to_vec();
        out.par_chunks_mut(gain.len()).for_each(|row| {
            vectorised(|| {
                let factor = inverse_root(row, self.eps);
                for (x, gain) in row.iter_mut().zip(gain) {
                    *x = *x * factor * gain;
                }
            });
        });
        Ok((CpuStorage::F32(out), x_layout.shape().clone()))
    }

    fn bwd(
        &self,
        x: &Tensor,
        gain: &Tensor,
        _: &Tensor,
        grad: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let (x, grad) = (x.contiguous()?, grad.contiguous()?);
        let of_x = x
            .track_op()
            .then(|| x.apply_op3_no_bwd(gain, &grad, &Backward { eps: self.eps }))
            .transpose()?;
        let of_gain = gain
            .track_op()
            .then(|| {
                // Σ over rows of grad * x / sqrt(mean(x²) + eps): the norm itself with a gain of grad.
                let plain = x.apply_op2_no_bwd(&gain.ones_like()?, self)?;
                (plain * &grad)?.flatten_to(D::Minus2)?.sum(0)
            })
            .transpose()?;
        Ok((of_x, of_gain))
    }
}

/// With f = 1 / sqrt(mean(x²) + eps) and h = grad * gain: `f h - x f³ mean(h x)`.
struct Backward {
    eps: f32,
}

impl CustomOp3 for Backward {
    fn name(&self) -> &'static str {
        "rms-norm-backward"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        gain: &CpuStorage,
        gain_layout: &Layout,
        grad: &CpuStorage,
        grad_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (x, gain) = (values(x, x_layout)?, values(gain, gain_layout)?);
        let mut out = values(grad, grad_layout)?.to_vec();
        let width = gain.len().max(1);
        let rows = out.par_chunks_mut(width).zip(x.par_chunks(width));
        rows.for_each(|(grad, x)| {
            vectorised(|| {
                let factor = inverse_root(x, self.eps);
                let n = x.len().min(gain.len()).min(grad.len());
                let (g, x, gain) = (&mut grad[..n], &x[..n], &gain[..n]);
                let mean = sum(n, |i| g[i] * gain[i] * x[i]) / n as f32;
                let pull = factor * factor * factor * mean;
                for ((g, x), gain) in g.iter_mut().zip(x).zip(gain) {
                    *g = factor * *g * gain - x * pull;
                }
            });
        });
        Ok((CpuStorage::F32(out), x_layout.shape().clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{Device, Var};

    #[test]
    fn values_and_gradients_are_candles() {
        let variable = |shape: &[usize], step: f32| {
            let count: usize = shape.iter().product();
            let values = (0..count).map(|i| 3.0 * (i as f32 * step).sin()).collect();
            let tensor = Tensor::from_vec(values, shape, &Device::Cpu).unwrap();
            Var::from_tensor(&tensor).unwrap()
        };
        let (x, gain) = (variable(&[2, 3, 37], 0.3), variable(&[37], 0.7));
        let close = |a: &Tensor, b: &Tensor| {
            let difference = (a - b).unwrap().abs().unwrap().flatten_all().unwrap();
            let largest: f32 = difference.max(0).unwrap().to_scalar().unwrap();
            assert!(largest < 2e-5, "{largest}");
        };
        let ours = rms_norm(&x, &gain, 1e-5).unwrap();
        let mean_square = x.sqr().unwrap().mean_keepdim(D::Minus1).unwrap();
        let root = (mean_square + 1e-5).unwrap().sqrt().unwrap();
        let theirs = x
            .broadcast_div(&root)
            .unwrap()
            .broadcast_mul(&gain)
            .unwrap();
        close(&ours, &theirs);
        let gradients = |out: Tensor| out.sin().unwrap().sum_all().unwrap().backward().unwrap();
        let (ours, theirs) = (gradients(ours), gradients(theirs));
        for variable in [&x, &gain] {
            close(ours.get(variable).unwrap(), theirs.get(variable).unwrap());
        }
        // A frozen gain gets none.
        let frozen = gain.as_detached_tensor();
        let gradients = rms_norm(&x, &frozen, 1e-5)
            .unwrap()
            .sum_all()
            .unwrap()
            .backward()
            .unwrap();
        assert!(gradients.get(&x).is_some() && gradients.get(&frozen).is_none());
    }
}
