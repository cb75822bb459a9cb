//! Linear maps whose backward pass computes what is asked for and nothing else.

use candle_core::{CpuStorage, CustomOp2, CustomOp3, Layout, Result, Shape, Tensor, D};

use super::matrix::{product, Into, Matrix, Threads};
use super::{serve, values};

/// `x·wᵀ + b` over the last dimension, with a weight (out, in) and perhaps a bias (out).
///
/// Where weight or bias is not a variable, no gradient is computed for it.
#[derive(Clone, Debug)]
pub struct Linear {
    weight: Tensor,
    bias: Option<Tensor>,
}

impl Linear {
    /// From a weight (out, in) and a bias (out).
    pub fn new(weight: Tensor, bias: Option<Tensor>) -> Self {
        Self { weight, bias }
    }

    /// (…, in) to (…, out).
    pub fn forward(&self, x: &Tensor) -> Result<Tensor> {
        if !serve(x) {
            let linear = candle_nn::Linear::new(self.weight.clone(), self.bias.clone());
            return candle_core::Module::forward(&linear, x);
        }
        let mut shape = x.dims().to_vec();
        if let Some(last) = shape.last_mut() {
            *last = self.weight.dim(0)?;
        }
        let rows = x.flatten_to(D::Minus2)?.contiguous()?;
        let out = match &self.bias {
            None => rows.apply_op2(&self.weight, Affine)?,
            Some(bias) => rows.apply_op3(&self.weight, bias, Affine)?,
        };
        out.reshape(shape)
    }
}

struct Affine;

/// `x·wᵀ` added to rows of the bias, or to nothing.
fn forward(
    (x, x_layout): (&CpuStorage, &Layout),
    (w, w_layout): (&CpuStorage, &Layout),
    bias: Option<&[f32]>,
) -> Result<(CpuStorage, Shape)> {
    let ((rows, inner), (outer, columns)) = (x_layout.shape().dims2()?, w_layout.shape().dims2()?);
    if inner != columns || bias.is_some_and(|bias| bias.len() != outer) {
        candle_core::bail!("a linear map of {columns} to {outer} values got {inner}");
    }
    let x = Matrix::new(values(x, x_layout)?, rows, inner);
    let w = Matrix::new(values(w, w_layout)?, outer, inner);
    let (mut out, into) = match bias {
        None => (vec![0.0; rows * outer], Into::Replace),
        Some(bias) => (bias.repeat(rows), Into::Add),
    };
    product(x, w.transposed(), 1.0, &mut out, outer, into, Threads::All);
    Ok((CpuStorage::F32(out), Shape::from((rows, outer))))
}

/// Gradients of input and weight, as far as they are wanted.
fn backward(x: &Tensor, w: &Tensor, grad: &Tensor) -> Result<(Option<Tensor>, Option<Tensor>)> {
    let wanted = |argument: &Tensor, left: &Tensor, right: &Tensor, op| {
        argument
            .track_op()
            .then(|| left.apply_op2_no_bwd(right, &op))
            .transpose()
    };
    Ok((
        wanted(x, grad, w, Backward::Input)?,
        wanted(w, grad, x, Backward::Weight)?,
    ))
}

enum Backward {
    /// grad (rows, out) times w (out, in).
    Input,
    /// gradᵀ (out, rows) times x (rows, in).
    Weight,
}

impl CustomOp2 for Backward {
    fn name(&self) -> &'static str {
        "linear-backward"
    }

    fn cpu_fwd(
        &self,
        grad: &CpuStorage,
        grad_layout: &Layout,
        other: &CpuStorage,
        other_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let ((rows, outer), (height, inner)) =
            (grad_layout.shape().dims2()?, other_layout.shape().dims2()?);
        let grad = Matrix::new(values(grad, grad_layout)?, rows, outer);
        let other = Matrix::new(values(other, other_layout)?, height, inner);
        let (grad, rows) = match self {
            Self::Input => (grad, rows),
            Self::Weight => (grad.transposed(), outer),
        };
        let mut out = vec![0.0; rows * inner];
        product(
            grad,
            other,
            1.0,
            &mut out,
            inner,
            Into::Replace,
            Threads::All,
        );
        Ok((CpuStorage::F32(out), Shape::from((rows, inner))))
    }
}

impl CustomOp2 for Affine {
    fn name(&self) -> &'static str {
        "linear"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        w: &CpuStorage,
        w_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        forward((x, x_layout), (w, w_layout), None)
    }

    fn bwd(
        &self,
        x: &Tensor,
        w: &Tensor,
        _: &Tensor,
        grad: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        backward(x, w, &grad.contiguous()?)
    }
}

impl CustomOp3 for Affine {
    fn name(&self) -> &'static str {
        "linear-with-bias"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        w: &CpuStorage,
        w_layout: &Layout,
        bias: &CpuStorage,
        bias_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let bias = values(bias, bias_layout)?;
        forward((x, x_layout), (w, w_layout), Some(bias))
    }

    fn bwd(
        &self,
        x: &Tensor,
        w: &Tensor,
        bias: &Tensor,
        _: &Tensor,
        grad: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let grad = grad.contiguous()?;
        let (of_x, of_w) = backward(x, w, &grad)?;
        let of_bias = bias.track_op().then(|| grad.sum(0)).transpose()?;
        Ok((of_x, of_w, of_bias))
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
            let ours = Linear::new(w.as_tensor().clone(), bias.clone());
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
    fn frozen_weights_get_no_gradient() {
        let x = Var::from_tensor(&tensor(&[4, 7], 0.3)).unwrap();
        let (w, b) = (tensor(&[3, 7], 0.7), tensor(&[3], 1.1));
        let out = Linear::new(w.clone(), Some(b.clone())).forward(&x).unwrap();
        let gradients = out.sum_all().unwrap().backward().unwrap();
        assert!(gradients.get(&x).is_some());
        assert!(gradients.get(&w).is_none() && gradients.get(&b).is_none());
    }

    #[test]
    fn a_bias_or_input_of_another_length_is_an_error() {
        let (x, w) = (tensor(&[4, 7], 0.3), tensor(&[3, 7], 0.7));
        assert!(Linear::new(w.clone(), Some(tensor(&[7], 1.0)))
            .forward(&x)
            .is_err());
        assert!(Linear::new(w, None).forward(&tensor(&[4, 6], 1.0)).is_err());
    }
}
