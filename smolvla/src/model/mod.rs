//! SmolVLA in candle, in the two phases that training and proving need.
//!
//! - [`prefix`]: images, language and state through the [`vision`] tower and the language layers, giving the
//!   per-layer key/value cache. Frozen in training: one run per frame, ever.
//! - [`expert`]: noisy actions and a time, through the expert's layers over that cache, giving the velocity.
//! - [`flow`]: the flow-matching loss between them; [`sampling`] follows the velocity from noise to actions.
//! - [`state_token`]: the one token of the prefix that training may change.
//! - [`visibility`]: which token sees which, and the positions of all.
//! - [`observe`]: watches the values inside a pass of the expert.
//!
//! - [`kernels`]: what their time is spent in, fast on the CPU.
//!
//! Everything but the vision tower is made of operations with a backward pass. (candle's fused softmax, norm,
//! attention and rotary operations have none and drop gradients silently; the kernels here have one, or say so.)

pub mod attention;
pub mod expert;
pub mod flow;
pub mod kernels;
pub mod layers;
pub mod observe;
pub mod prefix;
pub mod rope;
pub mod sampling;
pub mod state_token;
pub mod time_embedding;
pub mod visibility;
pub mod vision;

use std::collections::BTreeMap;

use candle_core::{DType, Device, Tensor, Var};

use crate::error::{PolicyError, Result};
use crate::frozen::FrozenPrecision;
use crate::layout::Layout;
use crate::weights::TensorSet;

/// Weights on a device, by LeRobot's names.
#[derive(Clone)]
pub struct Parameters {
    tensors: BTreeMap<String, Tensor>,
    /// The type of linear maps' weights and biases in the models made of them.
    operands: DType,
}

impl Parameters {
    /// Copies plain weights to a device.
    pub fn load(weights: &TensorSet, device: &Device) -> Result<Self> {
        let tensors = weights
            .iter()
            .map(|(name, t)| {
                Ok((
                    name.clone(),
                    Tensor::from_slice(&t.data, t.shape.as_slice(), device)?,
                ))
            })
            .collect::<Result<_>>()?;
        Ok(Self::from_tensors(tensors))
    }

    /// Moves plain weights to a device; on the CPU without a copy.
    pub fn take(weights: TensorSet, device: &Device) -> Result<Self> {
        let tensors = weights
            .into_iter()
            .map(|(name, t)| Ok((name, Tensor::from_vec(t.data, t.shape, device)?)))
            .collect::<Result<_>>()?;
        Ok(Self::from_tensors(tensors))
    }

    /// Moves plain weights to a device, those named in `trainable` as variables, which are also given by name.
    pub fn with_variables(
        weights: TensorSet,
        trainable: &Layout,
        device: &Device,
    ) -> Result<(Self, BTreeMap<String, Var>)> {
        let mut tensors = Self::take(weights, device)?.tensors;
        let mut variables = BTreeMap::new();
        for name in trainable.keys() {
            let tensor = tensors
                .get_mut(name)
                .ok_or_else(|| PolicyError::MissingTensor(name.clone()))?;
            let variable = Var::from_tensor(tensor)?;
            *tensor = variable.as_tensor().clone();
            variables.insert(name.clone(), variable);
        }
        Ok((Self::from_tensors(tensors), variables))
    }

    /// Uses tensors that are there already, for example trainable variables.
    pub fn from_tensors(tensors: BTreeMap<String, Tensor>) -> Self {
        Self {
            tensors,
            operands: DType::F32,
        }
    }

    /// The same weights, whose linear maps multiply in `precision`: for the frozen half.
    pub fn in_precision(&self, precision: FrozenPrecision) -> Self {
        Self {
            operands: precision.operands(),
            ..self.clone()
        }
    }

    /// The tensor of that name.
    pub fn get(&self, name: &str) -> Result<Tensor> {
        self.tensors
            .get(name)
            .cloned()
            .ok_or_else(|| PolicyError::MissingTensor(name.into()))
    }

    /// The weight or bias of a linear map, as it is multiplied and added.
    pub fn operand(&self, name: &str) -> Result<Tensor> {
        Ok(self.get(name)?.to_dtype(self.operands)?)
    }
}
