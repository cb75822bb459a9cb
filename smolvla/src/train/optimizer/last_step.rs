//! FedCM (Xu et al. 2021, arXiv:2106.10874): local steps follow the last global step in part, so that nodes with different recordings drift
//! apart less.
//!
//! In the paper a node steps by `x ← x − η·v` with `v = α·g + (1 − α)·Δ`. Here g is the gradient, and Δ is the last global step in local
//! units: `Δ = (x′ − x₀) / (η·K)`, with this round's first weights x₀, the last round's x′, and K local steps. If η changes within a round,
//! η·K is the sum of the rates. A round's K steps then contribute `(1 − α)·(x₀ − x′)`: the part 1 − α of the last global step.
//!
//! For AdamW, g is the quotient of the moments, which η multiplies. A global step of AdamW nodes consists of such quotients, of size about
//! 1; a plain gradient is smaller by orders of magnitude, and would be lost beside Δ. So the moments are those of the node's own gradients,
//! and Δ joins after them. Weight decay is as without FedCM.

use std::collections::BTreeMap;

use candle_core::{Tensor, Var};
use zk0_tensors::{TensorError, TensorSet};

use crate::error::{PolicyError, Result};

/// The last global step, and a local step's own part.
pub struct LastStep {
    /// α, above 0 and at most 1.
    alpha: f64,
    /// Each variable's Δ.
    direction: BTreeMap<String, Tensor>,
}

impl LastStep {
    /// From the last round's first weights. `variables` hold this round's, and `rates` is the sum of its steps' learning rates.
    ///
    /// # Errors
    /// [`PolicyError::Options`] for an α that is not in (0, 1]. [`TensorError`] for weights of another shape.
    pub fn new(
        variables: &BTreeMap<String, Var>,
        earlier: &TensorSet,
        alpha: f64,
        rates: f64,
    ) -> Result<Self> {
        check_alpha(alpha)?;
        let of = |(name, variable): (&String, &Var)| {
            let before = earlier.get(name);
            let before = before.ok_or_else(|| TensorError::Missing(name.clone()))?;
            let before = Tensor::from_slice(&before.data, &before.shape[..], variable.device())?;
            let way = (before - variable.as_detached_tensor())?;
            Ok((name.clone(), (way / rates)?))
        };
        Ok(Self {
            alpha,
            direction: variables.iter().map(of).collect::<Result<_>>()?,
        })
    }

    pub(super) fn own(&self) -> f64 {
        self.alpha
    }

    /// The other part of a step.
    pub(super) fn add(&self, name: &str, variable: &Var, learning_rate: f64) -> Result<()> {
        if let Some(direction) = self.direction.get(name) {
            let step = (direction * (learning_rate * (1.0 - self.alpha)))?;
            variable.set(&(variable.as_detached_tensor() - step)?)?;
        }
        Ok(())
    }
}

/// Refuses an α that FedCM cannot use.
///
/// # Errors
/// [`PolicyError::Options`] names the value.
pub fn check_alpha(alpha: f64) -> Result<()> {
    if alpha > 0.0 && alpha <= 1.0 {
        Ok(())
    } else {
        Err(PolicyError::Options(format!(
            "`fedcm_alpha` is {alpha}; it must be above 0 and at most 1, which leaves FedCM out"
        )))
    }
}
