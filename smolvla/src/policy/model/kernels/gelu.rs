//! GELU in its tanh form.

use candle_core::{CpuStorage, InplaceOp1, Layout, Result, Tensor};
use pulp::{Arch, Simd};

use crate::policy::model::kernels::dispatch::{in_blocks, serve, widened};
use crate::policy::model::kernels::vector::sigmoid;

/// `x/2 · (1 + tanh(sqrt(2/π) (x + 0.044715 x³)))` (Hendrycks and Gimpel, 2016), without a backward pass. On the CPU it reuses the memory
/// of `x`, which must not be shared. Shorter numbers become `f32`.
pub fn gelu_tanh(x: Tensor) -> Result<Tensor> {
    if serve(&x) {
        let x = x.contiguous()?;
        x.inplace_op1(&GeluTanh)?;
        Ok(x)
    } else {
        widened(&x)?.gelu()
    }
}

struct GeluTanh;

impl InplaceOp1 for GeluTanh {
    fn name(&self) -> &'static str {
        "gelu-tanh"
    }

    fn cpu_fwd(&self, storage: &mut CpuStorage, layout: &Layout) -> Result<()> {
        match (storage, layout.contiguous_offsets()) {
            (CpuStorage::F32(values), Some((from, to))) => {
                in_blocks(&mut values[from..to], |_, block| gelu_block(block));
                Ok(())
            }
            _ => candle_core::bail!("GELU needs contiguous f32, not {layout:?}"),
        }
    }
}

#[pulp::with_simd(gelu_block = Arch::new())]
#[inline(always)]
fn gelu_block_with<S: Simd>(_: S, block: &mut [f32]) {
    for x in block {
        // 1/2 (1 + tanh z) = sigmoid(2z)
        let z = 0.797_884_6 * (*x + 0.044_715 * *x * *x * *x);
        *x *= sigmoid(2.0 * z);
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
        let theirs: Vec<f32> = x.gelu().unwrap().to_vec1().unwrap();
        let ours: Vec<f32> = gelu_tanh(x).unwrap().to_vec1().unwrap();
        for (ours, theirs) in ours.iter().zip(&theirs) {
            assert!(
                (ours - theirs).abs() < 2e-6 * theirs.abs().max(1.0),
                "{ours} {theirs}"
            );
        }
    }
}
