//! SwiGLU's gate: `silu(gate) * up`, with both gradients in one pass.

use candle_core::{CpuStorage, CustomOp2, CustomOp3, Layout, Result, Shape, Tensor};
use pulp::{Arch, Simd};

use super::vector::sigmoid;
use super::{in_blocks, serve, values};

/// `silu(gate) * up` for two tensors of one shape (Shazeer, GLU Variants Improve Transformer, 2020).
pub fn swiglu(gate: &Tensor, up: &Tensor) -> Result<Tensor> {
    if serve(gate) {
        gate.contiguous()?.apply_op2(&up.contiguous()?, SwiGlu)
    } else {
        gate.silu()? * up
    }
}

struct SwiGlu;

impl CustomOp2 for SwiGlu {
    fn name(&self) -> &'static str {
        "swiglu"
    }

    fn cpu_fwd(
        &self,
        gate: &CpuStorage,
        gate_layout: &Layout,
        up: &CpuStorage,
        up_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let mut out = values(gate, gate_layout)?.to_vec();
        let up = values(up, up_layout)?;
        if gate_layout.shape() != up_layout.shape() {
            candle_core::bail!(
                "gate {:?} and up {:?}",
                gate_layout.shape(),
                up_layout.shape()
            );
        }
        in_blocks(&mut out, |from, gate| gated(gate, &up[from..]));
        Ok((CpuStorage::F32(out), gate_layout.shape().clone()))
    }

    fn bwd(
        &self,
        gate: &Tensor,
        up: &Tensor,
        _: &Tensor,
        grad: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let grad = grad.contiguous()?;
        let (gate, up) = (gate.contiguous()?, up.contiguous()?);
        let of = |op| grad.apply_op3_no_bwd(&gate, &up, &op);
        Ok((Some(of(Backward::Gate)?), Some(of(Backward::Up)?)))
    }
}

/// From grad, gate and up to the gradient of one of the two.
enum Backward {
    /// `grad * up * s * (1 + gate * (1 - s))` for s = sigmoid(gate).
    Gate,
    /// `grad * silu(gate)`.
    Up,
}

impl CustomOp3 for Backward {
    fn name(&self) -> &'static str {
        "swiglu-backward"
    }

    fn cpu_fwd(
        &self,
        grad: &CpuStorage,
        grad_layout: &Layout,
        gate: &CpuStorage,
        gate_layout: &Layout,
        up: &CpuStorage,
        up_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let mut out = values(grad, grad_layout)?.to_vec();
        let (gate, up) = (values(gate, gate_layout)?, values(up, up_layout)?);
        if gate_layout.shape() != grad_layout.shape() || up_layout.shape() != grad_layout.shape() {
            candle_core::bail!("a gradient {:?}", grad_layout.shape());
        }
        in_blocks(&mut out, |from, grad| match self {
            Self::Gate => gradient_of_gate(grad, &gate[from..], &up[from..]),
            Self::Up => gradient_of_up(grad, &gate[from..]),
        });
        Ok((CpuStorage::F32(out), grad_layout.shape().clone()))
    }
}

#[pulp::with_simd(gated = Arch::new())]
#[inline(always)]
fn gated_with<S: Simd>(_: S, gate: &mut [f32], up: &[f32]) {
    for (gate, up) in gate.iter_mut().zip(up) {
        *gate = *gate * sigmoid(*gate) * up;
    }
}

#[pulp::with_simd(gradient_of_gate = Arch::new())]
#[inline(always)]
fn gradient_of_gate_with<S: Simd>(_: S, grad: &mut [f32], gate: &[f32], up: &[f32]) {
    for ((grad, gate), up) in grad.iter_mut().zip(gate).zip(up) {
        let s = sigmoid(*gate);
        *grad *= up * s * (1.0 + gate * (1.0 - s));
    }
}

#[pulp::with_simd(gradient_of_up = Arch::new())]
#[inline(always)]
fn gradient_of_up_with<S: Simd>(_: S, grad: &mut [f32], gate: &[f32]) {
    for (grad, gate) in grad.iter_mut().zip(gate) {
        *grad *= gate * sigmoid(*gate);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{Device, Var};

    #[test]
    fn values_and_gradients_are_candles() {
        let variable = |step: f32| {
            let values = (0..200).map(|i| 5.0 * (i as f32 * step).sin()).collect();
            let tensor = Tensor::from_vec(values, (2, 10, 10), &Device::Cpu).unwrap();
            Var::from_tensor(&tensor).unwrap()
        };
        let (gate, up) = (variable(0.3), variable(0.7));
        let close = |a: &Tensor, b: &Tensor| {
            let difference = (a - b).unwrap().abs().unwrap().flatten_all().unwrap();
            let largest: f32 = difference.max(0).unwrap().to_scalar().unwrap();
            assert!(largest < 1e-4, "{largest}");
        };
        let ours = swiglu(&gate, &up).unwrap();
        let theirs = (gate.silu().unwrap() * up.as_tensor()).unwrap();
        close(&ours, &theirs);
        let gradients = |out: Tensor| out.sqr().unwrap().sum_all().unwrap().backward().unwrap();
        let (ours, theirs) = (gradients(ours), gradients(theirs));
        for variable in [&gate, &up] {
            close(ours.get(variable).unwrap(), theirs.get(variable).unwrap());
        }
    }
}
