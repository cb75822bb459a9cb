//! SiLU and SwiGLU, each gradient in one pass.

use candle_core::{Result, Tensor};
use pulp::{Arch, Simd};

use crate::policy::model::kernels::dispatch::{in_blocks, serve, widened};
use crate::policy::model::kernels::operation::{
    CpuOperation, CpuValues, Gradients, Kernel, KernelOutput,
};
use crate::policy::model::kernels::vector::sigmoid;

/// `silu(gate) * up` for one shape, with shorter numbers as `f32` (Shazeer, GLU Variants Improve Transformer, 2020).
pub fn swiglu(gate: &Tensor, up: &Tensor) -> Result<Tensor> {
    if serve(gate) {
        gate.contiguous()?
            .apply_op2(&up.contiguous()?, CpuOperation(SwiGlu))
    } else {
        widened(gate)?.silu()? * widened(up)?
    }
}

/// `x / (1 + e^−x)` (Elfwing et al., Sigmoid-Weighted Linear Units, 2018).
pub fn silu(x: &Tensor) -> Result<Tensor> {
    if serve(x) {
        x.contiguous()?.apply_op1(CpuOperation(Silu))
    } else {
        widened(x)?.silu()
    }
}

struct Silu;

impl Kernel<1> for Silu {
    const NAME: &'static str = "silu";

    fn forward(&self, [x]: [CpuValues; 1]) -> KernelOutput {
        let mut out = x.to_vec();
        in_blocks(&mut out, |_, x| silu_block(x));
        Ok((out, x.shape.clone()))
    }

    fn backward(&self, [x]: [&Tensor; 1], _: &Tensor, grad: &Tensor) -> Gradients<1> {
        let grad = grad.contiguous()?;
        grad.apply_op2_no_bwd(x, &CpuOperation(SiluBackward))
            .map(|of_x| [Some(of_x)])
    }
}

/// From grad and x to `grad * s * (1 + x * (1 - s))` for s = sigmoid(x).
struct SiluBackward;

impl Kernel<2> for SiluBackward {
    const NAME: &'static str = "silu-backward";

    fn forward(&self, [grad, x]: [CpuValues; 2]) -> KernelOutput {
        let mut out = grad.to_vec();
        if x.len() != out.len() {
            candle_core::bail!("a gradient {:?}", grad.shape);
        }
        in_blocks(&mut out, |from, grad| gradient_of_silu(grad, &x[from..]));
        Ok((out, grad.shape.clone()))
    }
}

struct SwiGlu;

impl Kernel<2> for SwiGlu {
    const NAME: &'static str = "swiglu";

    fn forward(&self, [gate, up]: [CpuValues; 2]) -> KernelOutput {
        let mut out = gate.to_vec();
        if gate.shape != up.shape {
            candle_core::bail!("gate {:?} and up {:?}", gate.shape, up.shape);
        }
        in_blocks(&mut out, |from, gate| gated(gate, &up[from..]));
        Ok((out, gate.shape.clone()))
    }

    fn backward(&self, [gate, up]: [&Tensor; 2], _: &Tensor, grad: &Tensor) -> Gradients<2> {
        let grad = grad.contiguous()?;
        let (gate, up) = (gate.contiguous()?, up.contiguous()?);
        let of = |op| grad.apply_op3_no_bwd(&gate, &up, &CpuOperation(op));
        Ok([
            Some(of(SwigluBackward::Gate)?),
            Some(of(SwigluBackward::Up)?),
        ])
    }
}

/// From grad, gate and up to one gradient.
enum SwigluBackward {
    /// `grad * up * s * (1 + gate * (1 - s))` for s = sigmoid(gate).
    Gate,
    /// `grad * silu(gate)`.
    Up,
}

impl Kernel<3> for SwigluBackward {
    const NAME: &'static str = "swiglu-backward";

    fn forward(&self, [grad, gate, up]: [CpuValues; 3]) -> KernelOutput {
        let mut out = grad.to_vec();
        if gate.shape != grad.shape || up.shape != grad.shape {
            candle_core::bail!("a gradient {:?}", grad.shape);
        }
        in_blocks(&mut out, |from, grad| match self {
            Self::Gate => gradient_of_gate(grad, &gate[from..], &up[from..]),
            Self::Up => gradient_of_up(grad, &gate[from..]),
        });
        Ok((out, grad.shape.clone()))
    }
}

#[pulp::with_simd(silu_block = Arch::new())]
#[inline(always)]
fn silu_block_with<S: Simd>(_: S, block: &mut [f32]) {
    for x in block {
        *x *= sigmoid(*x);
    }
}

#[pulp::with_simd(gradient_of_silu = Arch::new())]
#[inline(always)]
fn gradient_of_silu_with<S: Simd>(_: S, grad: &mut [f32], x: &[f32]) {
    for (grad, x) in grad.iter_mut().zip(x) {
        let s = sigmoid(*x);
        *grad *= s * (1.0 + x * (1.0 - s));
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
        let gradients = |out: &Tensor| out.sqr().unwrap().sum_all().unwrap().backward().unwrap();
        let ours = swiglu(&gate, &up).unwrap();
        let theirs = (gate.silu().unwrap() * up.as_tensor()).unwrap();
        close(&ours, &theirs);
        let (ours, theirs) = (gradients(&ours), gradients(&theirs));
        for variable in [&gate, &up] {
            close(ours.get(variable).unwrap(), theirs.get(variable).unwrap());
        }
        let (ours, theirs) = (silu(&gate).unwrap(), gate.silu().unwrap());
        close(&ours, &theirs);
        let (ours, theirs) = (gradients(&ours), gradients(&theirs));
        close(ours.get(&gate).unwrap(), theirs.get(&gate).unwrap());
    }
}
