//! What optimisers have in common: they make steps by gradients.

use candle_core::backprop::GradStore;
use candle_core::{Tensor, Var};

use crate::error::{PolicyError, Result};

/// What a step found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stepped {
    /// L2 norm of the gradient over all tensors, proximal term included, before clipping.
    pub gradient_norm: f64,
    /// The proximal term before the step, `mu / 2 * |w - w0|^2`; 0 without one.
    pub proximal: f64,
}

/// Changes variables by the gradients of a loss.
pub trait Optimizer {
    /// One step.
    ///
    /// # Errors
    /// [`PolicyError::NoGradient`] when a variable has none: some operation between it and the loss has no backward pass.
    /// [`PolicyError::GradientNotFinite`] when one is not a number; nothing has changed then.
    fn step(&mut self, gradients: &GradStore, learning_rate: f64) -> Result<Stepped>;
}

/// The gradient of a variable, apart from the graph that it was computed in.
pub(super) fn gradient(gradients: &GradStore, name: &str, variable: &Var) -> Result<Tensor> {
    let gradient = gradients
        .get(variable.as_tensor())
        .ok_or_else(|| PolicyError::NoGradient(name.into()))?;
    // Without detaching, moments that are computed from it would keep the graph of every step in memory.
    Ok(gradient.detach().contiguous()?)
}
