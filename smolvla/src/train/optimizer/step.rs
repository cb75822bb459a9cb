//! What optimisers share: steps by gradients.

use candle_core::backprop::GradStore;
use candle_core::{Tensor, Var};

use crate::error::{PolicyError, Result};

/// What a step measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stepped {
    /// The gradient's L2 norm with the proximal term, before clipping.
    pub gradient_norm: f64,
    /// The proximal term before the step, `mu / 2 * |w - w0|^2`; 0 without one.
    pub proximal: f64,
}

/// Changes variables by a loss's gradients.
pub trait Optimizer {
    /// Makes one step.
    ///
    /// # Errors
    /// [`PolicyError::NoGradient`] or [`PolicyError::GradientNotFinite`]; then nothing has changed.
    fn step(&mut self, gradients: &GradStore, learning_rate: f64) -> Result<Stepped>;
}

pub(super) fn gradient(gradients: &GradStore, name: &str, variable: &Var) -> Result<Tensor> {
    let gradient = gradients
        .get(variable.as_tensor())
        .ok_or_else(|| PolicyError::NoGradient(name.into()))?;
    // Otherwise moments would keep every step's graph.
    Ok(gradient.detach().contiguous()?)
}
