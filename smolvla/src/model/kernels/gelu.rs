//! The tanh form of GELU, for layers without a gradient.

use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor};
use rayon::prelude::*;

use super::vector::{sigmoid, vectorised};
use super::{serve, values};

/// Values a task.
const BLOCK: usize = 1 << 14;

/// `x/2 · (1 + tanh(sqrt(2/π) (x + 0.044715 x³)))` (Hendrycks and Gimpel, 2016). Has no backward pass.
pub fn gelu_tanh(x: &Tensor) -> Result<Tensor> {
    if serve(x) {
        x.contiguous()?.apply_op1_no_bwd(&GeluTanh)
    } else {
        x.gelu()
    }
}

struct GeluTanh;

impl CustomOp1 for GeluTanh {
    fn name(&self) -> &'static str {
        "gelu-tanh"
    }

    fn cpu_fwd(&self, x: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let mut out = values(x, layout)?.to_vec();
        out.par_chunks_mut(BLOCK).for_each(|block| {
            vectorised(|| {
                for x in block {
                    // 1/2 (1 + tanh z) = sigmoid(2z)
                    let z = 0.797_884_6 * (*x + 0.044_715 * *x * *x * *x);
                    *x *= sigmoid(2.0 * z);
                }
            });
        });
        Ok((CpuStorage::F32(out), layout.shape().clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::Device;

    #[test]
    fn values_are_candles() {
        let x: Vec<f32> = (-400..400).map(|i| i as f32 * 0.05).collect();
        let x = Tensor::from_vec(x, 800, &Device::Cpu).unwrap();
        let ours: Vec<f32> = gelu_tanh(&x).unwrap().to_vec1().unwrap();
        let theirs: Vec<f32> = x.gelu().unwrap().to_vec1().unwrap();
        for (ours, theirs) in ours.iter().zip(&theirs) {
            assert!(
                (ours - theirs).abs() < 2e-6 * theirs.abs().max(1.0),
                "{ours} {theirs}"
            );
        }
    }
}
