//! Linear maps whose backward pass computes only what is needed.

use candle_core::{Result, Shape, Tensor, D};

use crate::policy::model::kernels::dispatch::{in_chunks, serve};
use crate::policy::model::kernels::gradients::collect;
use crate::policy::model::kernels::matmul::matmul;
use crate::policy::model::kernels::matrix::{product, product_of, Into, StridedMatrix, Threads};
use crate::policy::model::kernels::operation::{
    CpuOperation, CpuValues, Gradients, Kernel, KernelOutput,
};

/// `x·wᵀ + b` over the last dimension, with a weight (out, in) and optionally a bias (out). A weight with shorter numbers
/// ([bf16](crate::policy::frozen::FrozenPrecision)) rounds input and output to them. Only variables get gradients.
#[derive(Clone, Debug)]
pub struct LinearLayer {
    weight: Tensor,
    bias: Option<Tensor>,
}

impl LinearLayer {
    /// From a weight (out, in) and a bias (out).
    pub fn new(weight: Tensor, bias: Option<Tensor>) -> Self {
        Self { weight, bias }
    }

    /// (…, in) to (…, out).
    pub fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let x = &x.to_dtype(self.weight.dtype())?;
        let mut shape = x.dims().to_vec();
        if let Some(last) = shape.last_mut() {
            *last = self.weight.dim(0)?;
        }
        let rows = x.flatten_to(D::Minus2)?.contiguous()?;
        let out = match (serve(x), &self.bias) {
            (true, None) => rows.apply_op2(&self.weight, CpuOperation(LinearForward))?,
            (true, Some(bias)) => {
                rows.apply_op3(&self.weight, bias, CpuOperation(LinearForward))?
            }
            (false, None) => matmul(&rows, &self.weight.t()?)?,
            (false, Some(bias)) => matmul(&rows, &self.weight.t()?)?.broadcast_add(bias)?,
        };
        out.reshape(shape)
    }

    /// `residual + x·wᵀ + b` for a residual (…, out), in one pass and its type, without a backward pass.
    pub fn forward_onto(&self, residual: &Tensor, x: &Tensor) -> Result<Tensor> {
        if !serve(x) || !serve(&self.weight) {
            return self.forward(x)?.to_dtype(residual.dtype())? + residual;
        }
        let rows = x.flatten_to(D::Minus2)?.contiguous()?;
        let onto = residual.flatten_to(D::Minus2)?.contiguous()?;
        let bias = self.bias.as_ref();
        rows.apply_op3_no_bwd(&self.weight, &onto, &CpuOperation(Onto { bias }))?
            .reshape(residual.shape())
    }
}

struct Onto<'a> {
    bias: Option<&'a Tensor>,
}

impl Kernel<3> for Onto<'_> {
    const NAME: &'static str = "linear-onto";

    fn forward(&self, [x, w, residual]: [CpuValues; 3]) -> KernelOutput {
        let mut onto = residual.to_vec();
        if let Some(bias) = self.bias {
            let bias = bias.to_vec1::<f32>()?;
            in_chunks(&mut onto, bias.len(), 1, |_, row| {
                row.iter_mut().zip(&bias).for_each(|(x, b)| *x += b);
            });
        }
        forward(x, w, Some(onto))
    }
}

struct LinearForward;

fn forward(x: CpuValues, w: CpuValues, onto: Option<Vec<f32>>) -> KernelOutput {
    let ((rows, inner), (outer, columns)) = (x.shape.dims2()?, w.shape.dims2()?);
    if inner != columns || onto.as_ref().is_some_and(|onto| onto.len() != rows * outer) {
        candle_core::bail!(
            "a linear map of {columns} to {outer} values got {rows} rows of {inner}, or a bias or residual of another length"
        );
    }
    let x = StridedMatrix::new(&x, rows, inner);
    let w = StridedMatrix::new(&w, outer, inner).transposed();
    let out = match onto {
        None => product_of(x, w),
        Some(mut onto) => {
            product(x, w, 1.0, &mut onto, outer, Into::Add, Threads::All);
            onto
        }
    };
    Ok((out, Shape::from((rows, outer))))
}

fn backward(x: &Tensor, w: &Tensor, grad: &Tensor) -> Gradients<2> {
    let wanted = |argument: &Tensor, left: &Tensor, right: &Tensor, op| {
        argument
            .track_op()
            .then(|| left.apply_op2_no_bwd(right, &CpuOperation(op)))
            .transpose()
    };
    let of_w = wanted(w, grad, x, LinearBackward::Weight)?;
    Ok([
        wanted(x, grad, w, LinearBackward::Input)?,
        of_w.and_then(|gradient| collect(w, gradient)),
    ])
}

enum LinearBackward {
    /// grad (rows, out) times w (out, in).
    Input,
    /// gradᵀ (out, rows) times x (rows, in).
    Weight,
}

impl Kernel<2> for LinearBackward {
    const NAME: &'static str = "linear-backward";

    fn forward(&self, [grad, other]: [CpuValues; 2]) -> KernelOutput {
        let ((rows, outer), (height, inner)) = (grad.shape.dims2()?, other.shape.dims2()?);
        let grad = StridedMatrix::new(&grad, rows, outer);
        let other = StridedMatrix::new(&other, height, inner);
        let (grad, rows) = match self {
            Self::Input => (grad, rows),
            Self::Weight => (grad.transposed(), outer),
        };
        let out = product_of(grad, other);
        Ok((out, Shape::from((rows, inner))))
    }
}

impl Kernel<2> for LinearForward {
    const NAME: &'static str = "linear";

    fn forward(&self, [x, w]: [CpuValues; 2]) -> KernelOutput {
        forward(x, w, None)
    }

    fn backward(&self, [x, w]: [&Tensor; 2], _: &Tensor, grad: &Tensor) -> Gradients<2> {
        backward(x, w, &grad.contiguous()?)
    }
}

impl Kernel<3> for LinearForward {
    const NAME: &'static str = "linear-with-bias";

    fn forward(&self, [x, w, bias]: [CpuValues; 3]) -> KernelOutput {
        let rows = x.shape.dims2()?.0;
        let onto = bias.repeat(rows);
        forward(x, w, Some(onto))
    }

    fn backward(&self, [x, w, bias]: [&Tensor; 3], _: &Tensor, grad: &Tensor) -> Gradients<3> {
        let grad = grad.contiguous()?;
        let [of_x, of_w] = backward(x, w, &grad)?;
        let of_bias = bias.track_op().then(|| grad.sum(0)).transpose()?;
        Ok([of_x, of_w, of_bias])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{Device, Module as _, Var};

    fn tensor(shape: &[usize], step: f32) -> Tensor {
        let count: usize = shape.iter().product();
        let values = (0..count).map(|i| (i as f32 * step).sin()).collect();
        Tensor::from_vec(values, shape, &Device::Cpu).unwrap()
    }

    fn distance(a: &Tensor, b: &Tensor) -> f32 {
        let difference = (a - b).unwrap().abs().unwrap().flatten_all().unwrap();
        difference.max(0).unwrap().to_scalar().unwrap()
    }

    #[test]
    fn values_and_gradients_are_candles() {
        let variable = |shape: &[usize], step| Var::from_tensor(&tensor(shape, step)).unwrap();
        let (x, w, b) = (
            variable(&[2, 5, 7], 0.3),
            variable(&[3, 7], 0.7),
            variable(&[3], 1.1),
        );
        let weights = tensor(&[2, 5, 3], 0.9);
        for bias in [None, Some(b.as_tensor().clone())] {
            let ours = LinearLayer::new(w.as_tensor().clone(), bias.clone());
            let theirs = candle_nn::Linear::new(w.as_tensor().clone(), bias.clone());
            let (ours, theirs) = (ours.forward(&x).unwrap(), theirs.forward(&x).unwrap());
            assert!(distance(&ours, &theirs) < 1e-6);
            let gradients = |out: Tensor| (out * &weights).unwrap().sum_all().unwrap().backward();
            let (ours, theirs) = (gradients(ours).unwrap(), gradients(theirs).unwrap());
            for variable in [&x, &w].into_iter().chain(bias.is_some().then_some(&b)) {
                let (ours, theirs) = (ours.get(variable).unwrap(), theirs.get(variable).unwrap());
                assert!(distance(ours, theirs) < 1e-5);
            }
        }
    }

    #[test]
    fn a_residual_is_added() {
        let (x, residual) = (tensor(&[2, 5, 7], 0.3), tensor(&[2, 5, 3], 0.9));
        for bias in [None, Some(tensor(&[3], 1.1))] {
            let linear = LinearLayer::new(tensor(&[3, 7], 0.7), bias);
            let ours = linear.forward_onto(&residual, &x).unwrap();
            let theirs = (linear.forward(&x).unwrap() + &residual).unwrap();
            assert!(distance(&ours, &theirs) < 1e-6);
            assert!(linear.forward_onto(&x, &x).is_err());
        }
    }

    #[test]
    fn frozen_weights_get_no_gradient() {
        let x = Var::from_tensor(&tensor(&[4, 7], 0.3)).unwrap();
        let (w, b) = (tensor(&[3, 7], 0.7), tensor(&[3], 1.1));
        let out = LinearLayer::new(w.clone(), Some(b.clone()))
            .forward(&x)
            .unwrap();
        let gradients = out.sum_all().unwrap().backward().unwrap();
        assert!(gradients.get(&x).is_some());
        assert!(gradients.get(&w).is_none() && gradients.get(&b).is_none());
    }

    #[test]
    fn a_bias_or_input_of_another_length_is_an_error() {
        let (x, w) = (tensor(&[4, 7], 0.3), tensor(&[3, 7], 0.7));
        assert!(LinearLayer::new(w.clone(), Some(tensor(&[7], 1.0)))
            .forward(&x)
            .is_err());
        assert!(LinearLayer::new(w, None)
            .forward(&tensor(&[4, 6], 1.0))
            .is_err());
    }
}
