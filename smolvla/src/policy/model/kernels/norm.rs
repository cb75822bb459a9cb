//! RMSNorm (Zhang and Sennrich, 2019), and the frozen vision tower's layer norm.

use candle_core::{Result, Tensor, D};
use pulp::{Arch, Simd};

use crate::policy::model::kernels::dispatch::{in_chunks, serve};
use crate::policy::model::kernels::operation::{
    CpuOperation, CpuValues, Gradients, Kernel, KernelOutput,
};
use crate::policy::model::kernels::vector::sum;

/// `x / sqrt(mean(x²) + eps) * gain` over the last dimension. Only a variable gain gets a gradient.
pub fn rms_norm(x: &Tensor, gain: &Tensor, eps: f64) -> Result<Tensor> {
    if serve(x) {
        let eps = eps as f32;
        return x
            .contiguous()?
            .apply_op2(gain, CpuOperation(RmsNormKernel { eps }));
    }
    let mean_square = x.sqr()?.mean_keepdim(D::Minus1)?;
    x.broadcast_div(&(mean_square + eps)?.sqrt()?)?
        .broadcast_mul(gain)
}

/// `(x - mean) / sqrt(variance + eps) * gain + bias` over the last dimension (Ba et al., Layer Normalization, 2016), without a backward
/// pass. The variance is the mean square of `x - mean`, more exact than candle's difference of large numbers.
pub fn layer_norm(x: &Tensor, gain: &Tensor, bias: &Tensor, eps: f64) -> Result<Tensor> {
    if serve(x) {
        let eps = eps as f32;
        return x.contiguous()?.apply_op3_no_bwd(
            gain,
            bias,
            &CpuOperation(LayerNormKernel { eps }),
        );
    }
    let centred = x.broadcast_sub(&x.mean_keepdim(D::Minus1)?)?;
    let variance = centred.sqr()?.mean_keepdim(D::Minus1)?;
    centred
        .broadcast_div(&(variance + eps)?.sqrt()?)?
        .broadcast_mul(gain)?
        .broadcast_add(bias)
}

struct LayerNormKernel {
    eps: f32,
}

impl Kernel<3> for LayerNormKernel {
    const NAME: &'static str = "layer-norm";

    fn forward(&self, [x, gain, bias]: [CpuValues; 3]) -> KernelOutput {
        let width = gain.len();
        if x.shape.dims().last() != Some(&width) || bias.len() != width || width == 0 {
            candle_core::bail!("a norm of {width} values got {:?}", x.shape);
        }
        let mut out = x.to_vec();
        in_chunks(&mut out, width, 6, |_, row| {
            standardise(row, &gain, &bias, self.eps)
        });
        Ok((out, x.shape.clone()))
    }
}

#[pulp::with_simd(standardise = Arch::new())]
#[inline(always)]
fn standardise_with<S: Simd>(_: S, row: &mut [f32], gain: &[f32], bias: &[f32], eps: f32) {
    let values = &*row;
    let mean = sum(values.len(), |i| values[i]) / values.len() as f32;
    for x in row.iter_mut() {
        *x -= mean;
    }
    let factor = inverse_root(row, eps);
    for ((x, gain), bias) in row.iter_mut().zip(gain).zip(bias) {
        *x = *x * factor * gain + bias;
    }
}

#[derive(Clone, Copy)]
struct RmsNormKernel {
    eps: f32,
}

#[inline(always)]
fn inverse_root(x: &[f32], eps: f32) -> f32 {
    let mean_square = sum(x.len(), |i| x[i] * x[i]) / x.len() as f32;
    1.0 / (mean_square + eps).sqrt()
}

impl Kernel<2> for RmsNormKernel {
    const NAME: &'static str = "rms-norm";

    fn forward(&self, [x, gain]: [CpuValues; 2]) -> KernelOutput {
        if x.shape.dims().last() != Some(&gain.len()) || gain.is_empty() {
            candle_core::bail!("a norm of {} values got {:?}", gain.len(), x.shape);
        }
        let mut out = x.to_vec();
        in_chunks(&mut out, gain.len(), 4, |_, row| {
            normalise(row, &gain, self.eps)
        });
        Ok((out, x.shape.clone()))
    }

    fn backward(&self, [x, gain]: [&Tensor; 2], _: &Tensor, grad: &Tensor) -> Gradients<2> {
        let (x, grad) = (x.contiguous()?, grad.contiguous()?);
        let of_x = x
            .track_op()
            .then(|| {
                x.apply_op3_no_bwd(
                    gain,
                    &grad,
                    &CpuOperation(RmsNormBackward { eps: self.eps }),
                )
            })
            .transpose()?;
        let of_gain = gain
            .track_op()
            .then(|| {
                // The sum over rows of grad * x / sqrt(mean(x²) + eps): the norm with grad as gain.
                let plain = x.apply_op2_no_bwd(&gain.ones_like()?, &CpuOperation(*self))?;
                (plain * &grad)?.flatten_to(D::Minus2)?.sum(0)
            })
            .transpose()?;
        Ok([of_x, of_gain])
    }
}

/// With f = 1 / sqrt(mean(x²) + eps) and h = grad * gain: `f h - x f³ mean(h x)`.
struct RmsNormBackward {
    eps: f32,
}

impl Kernel<3> for RmsNormBackward {
    const NAME: &'static str = "rms-norm-backward";

    fn forward(&self, [x, gain, grad]: [CpuValues; 3]) -> KernelOutput {
        let mut out = grad.to_vec();
        let width = gain.len().max(1);
        in_chunks(&mut out, width, 8, |row, grad| {
            gradient(grad, &x[row * width..][..grad.len()], &gain, self.eps)
        });
        Ok((out, x.shape.clone()))
    }
}

#[pulp::with_simd(normalise = Arch::new())]
#[inline(always)]
fn normalise_with<S: Simd>(_: S, row: &mut [f32], gain: &[f32], eps: f32) {
    let factor = inverse_root(row, eps);
    for (x, gain) in row.iter_mut().zip(gain) {
        *x = *x * factor * gain;
    }
}

#[pulp::with_simd(gradient = Arch::new())]
#[inline(always)]
fn gradient_with<S: Simd>(_: S, grad: &mut [f32], x: &[f32], gain: &[f32], eps: f32) {
    let factor = inverse_root(x, eps);
    let n = x.len().min(gain.len()).min(grad.len());
    let (g, x, gain) = (&mut grad[..n], &x[..n], &gain[..n]);
    let mean = sum(n, |i| g[i] * gain[i] * x[i]) / n as f32;
    let pull = factor * factor * factor * mean;
    for ((g, x), gain) in g.iter_mut().zip(x).zip(gain) {
        *g = factor * *g * gain - x * pull;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{DType, Device, Var};

    #[test]
    fn layer_norms_are_exact_far_from_zero() {
        let values: Vec<f32> = (0..74).map(|i| 100.0 + (i as f32 * 0.3).sin()).collect();
        let x = Tensor::from_vec(values, (2, 37), &Device::Cpu).unwrap();
        let (gain, bias) = (x.get(0).unwrap(), x.get(1).unwrap());
        let ours = layer_norm(&x, &gain, &bias, 1e-6).unwrap();
        let rows = |x: &Tensor| x.to_dtype(DType::F64).unwrap().to_vec2::<f64>().unwrap();
        let (x_rows, gain_and_bias) = (rows(&x), rows(&x));
        for (row, ours) in x_rows.iter().zip(rows(&ours)) {
            let mean = row.iter().sum::<f64>() / 37.0;
            let variance = row.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 37.0;
            for (i, ours) in ours.into_iter().enumerate() {
                let unit = (row[i] - mean) / (variance + 1e-6).sqrt();
                let exact = unit * gain_and_bias[0][i] + gain_and_bias[1][i];
                assert!((ours - exact).abs() < 2e-3, "{ours} {exact}");
            }
        }
        assert!(layer_norm(&x, &gain, &bias.narrow(0, 0, 5).unwrap(), 1e-6).is_err());
    }

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
