//! Stochastic gradient descent, and SCAFFOLD's correction.
//!
//! A step is `x ← x − η·(g + d)`; with d = 0, that of `torch.optim.SGD` without momentum and weight decay. For SCAFFOLD, d is `c − cᵢ`
//! ([`ControlVariates`](crate::train::scaffold::ControlVariates)), constant within a round. Gradients are not clipped, as in the paper's
//! Algorithm 1: control variates must be means of gradients.

use std::collections::BTreeMap;

use candle_core::backprop::GradStore;
use candle_core::{Tensor, Var};
use zk0_tensors::{TensorError, TensorSet};

use crate::error::{PolicyError, Result};
use crate::train::optimizer::step::{gradient, Optimizer, Stepped};

/// SGD over named variables.
pub struct Sgd {
    variables: BTreeMap<String, (Var, Option<Tensor>)>,
}

impl Sgd {
    /// Adds `correction` to each gradient, if given.
    ///
    /// # Errors
    /// [`TensorError`] for a correction that lacks a variable, or has another shape.
    pub fn new(variables: &BTreeMap<String, Var>, correction: Option<&TensorSet>) -> Result<Self> {
        let of = |(name, variable): (&String, &Var)| {
            let Some(all) = correction else {
                return Ok((name.clone(), (variable.clone(), None)));
            };
            let own = all
                .get(name)
                .ok_or_else(|| TensorError::Missing(name.clone()))?;
            own.check_shape(name, variable.dims())?;
            let own = Tensor::from_slice(&own.data, &own.shape[..], variable.device())?;
            Ok((name.clone(), (variable.clone(), Some(own))))
        };
        Ok(Self {
            variables: variables.iter().map(of).collect::<Result<_>>()?,
        })
    }
}

impl Optimizer for Sgd {
    fn step(&mut self, gradients: &GradStore, learning_rate: f64) -> Result<Stepped> {
        let mut squares = 0.0;
        for (name, (variable, _)) in &self.variables {
            let gradient = gradient(gradients, name, variable)?;
            squares += f64::from(gradient.sqr()?.sum_all()?.to_scalar::<f32>()?);
        }
        let norm = squares.sqrt();
        if !norm.is_finite() {
            return Err(PolicyError::GradientNotFinite { norm });
        }
        for (name, (variable, correction)) in &self.variables {
            let mut way = gradient(gradients, name, variable)?;
            if let Some(correction) = correction {
                way = (way + correction)?;
            }
            let step = (way * learning_rate)?;
            variable.set(&(variable.as_detached_tensor() - step)?)?;
        }
        Ok(Stepped {
            gradient_norm: norm,
            proximal: 0.0,
        })
    }
}
