//! Weights on a device.

use std::collections::BTreeMap;

use candle_core::{DType, Device, Tensor, Var};
use zk0_tensors::{TensorError, TensorSet, TensorShapes};

use crate::error::Result;
use crate::policy::frozen::FrozenPrecision;

/// Weights on a device, by LeRobot's names.
#[derive(Clone)]
pub struct PolicyParameters {
    tensors: BTreeMap<String, Tensor>,
    /// Of linear maps' weights and biases.
    pub(super) operands: DType,
}

impl PolicyParameters {
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

    /// Moves plain weights to a device, on the CPU without a copy.
    pub fn take(weights: TensorSet, device: &Device) -> Result<Self> {
        let tensors = weights
            .into_iter()
            .map(|(name, t)| Ok((name, Tensor::from_vec(t.data, t.shape, device)?)))
            .collect::<Result<_>>()?;
        Ok(Self::from_tensors(tensors))
    }

    /// Moves plain weights to a device, and returns those in `trainable` as variables, too.
    pub fn with_variables(
        weights: TensorSet,
        trainable: &TensorShapes,
        device: &Device,
    ) -> Result<(Self, BTreeMap<String, Var>)> {
        let mut tensors = Self::take(weights, device)?.tensors;
        let mut variables = BTreeMap::new();
        for name in trainable.keys() {
            let tensor = tensors
                .get_mut(name)
                .ok_or_else(|| TensorError::Missing(name.clone()))?;
            let variable = Var::from_tensor(tensor)?;
            *tensor = variable.as_tensor().clone();
            variables.insert(name.clone(), variable);
        }
        Ok((Self::from_tensors(tensors), variables))
    }

    /// From existing tensors.
    pub fn from_tensors(tensors: BTreeMap<String, Tensor>) -> Self {
        Self {
            tensors,
            operands: DType::F32,
        }
    }

    /// The same weights, with linear maps in `precision`.
    pub fn in_precision(&self, precision: FrozenPrecision) -> Self {
        Self {
            operands: precision.operands(),
            ..self.clone()
        }
    }

    /// The tensor `name`.
    pub fn get(&self, name: &str) -> Result<Tensor> {
        self.tensors
            .get(name)
            .cloned()
            .ok_or_else(|| TensorError::Missing(name.into()).into())
    }

    /// A linear map's weight or bias, in the operands' type.
    pub fn operand(&self, name: &str) -> Result<Tensor> {
        Ok(self.get(name)?.to_dtype(self.operands)?)
    }
}
