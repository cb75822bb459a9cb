//! Weights as plain numbers: named `f32` tensors, read from and written to safetensors.
//!
//! Reading checks everything at once: names, shapes and types against the [`Layout`] of the configuration,
//! and that every number is finite. Writing is deterministic: equal weights give equal bytes.

use std::collections::BTreeMap;

use safetensors::tensor::{Dtype, SafeTensors};

use crate::config::PolicyConfig;
use crate::error::{PolicyError, Result};
use crate::layout::{expert_layout, policy_layout, Layout, LM_HEAD};
use crate::safetensors_writer::{self, Entry};

/// One tensor, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct TensorData {
    /// Dimensions.
    pub shape: Vec<usize>,
    /// As many elements as the dimensions' product.
    pub data: Vec<f32>,
}

/// Tensors by LeRobot's names, in name order.
pub type TensorSet = BTreeMap<String, TensorData>;

/// The tensors that training changes and that nodes exchange: the expert's layers and final norm, and the
/// action and time projections. Always complete, of the configuration's shapes, and finite.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpertWeights(TensorSet);

impl ExpertWeights {
    /// Reads the bytes of a safetensors file holding exactly the expert's tensors.
    ///
    /// # Errors
    /// Says which tensor is missing, unexpected, of another shape or type, or not finite.
    pub fn from_safetensors(config: &PolicyConfig, bytes: &[u8]) -> Result<Self> {
        Ok(Self(read(bytes, &expert_layout(config), &[])?))
    }

    /// Takes tensors made elsewhere (an average of several updates, say), with the same checks.
    pub fn from_tensors(config: &PolicyConfig, tensors: TensorSet) -> Result<Self> {
        check(&tensors, &expert_layout(config))?;
        Ok(Self(tensors))
    }

    /// The bytes of a safetensors file; equal weights give equal bytes.
    pub fn to_safetensors(&self) -> Result<Vec<u8>> {
        write(self.0.iter())
    }

    /// The tensors in name order.
    pub fn tensors(&self) -> &TensorSet {
        &self.0
    }

    /// Gives the tensors away.
    pub fn into_tensors(self) -> TensorSet {
        self.0
    }
}

/// A whole policy: the half that stays frozen and the expert.
#[derive(Clone, Debug, PartialEq)]
pub struct Policy {
    /// Its dimensions.
    pub config: PolicyConfig,
    /// Vision tower, connector, language layers and state projection.
    pub frozen: TensorSet,
    /// The trainable rest.
    pub expert: ExpertWeights,
}

impl Policy {
    /// Reads LeRobot's `policy.state_dict()` as safetensors bytes. The language model's `lm_head`, which the
    /// policy never uses, may be there.
    ///
    /// # Errors
    /// As [`ExpertWeights::from_safetensors`].
    pub fn from_safetensors(config: &PolicyConfig, bytes: &[u8]) -> Result<Self> {
        config.validate()?;
        let all = read(bytes, &policy_layout(config), &[LM_HEAD])?;
        Ok(Self::split(config, all))
    }

    /// Splits a complete, checked set into its two halves.
    pub(crate) fn split(config: &PolicyConfig, all: TensorSet) -> Self {
        let trainable = expert_layout(config);
        let (expert, frozen) = all
            .into_iter()
            .partition(|(name, _)| trainable.contains_key(name));
        Self {
            config: config.clone(),
            frozen,
            expert: ExpertWeights(expert),
        }
    }

    /// All tensors: the frozen ones in name order, then the expert's.
    pub fn tensors(&self) -> impl Iterator<Item = (&String, &TensorData)> {
        self.frozen.iter().chain(&self.expert.0)
    }

    /// The bytes of a safetensors file with LeRobot's names; equal policies give equal bytes.
    pub fn to_safetensors(&self) -> Result<Vec<u8>> {
        write(self.tensors())
    }
}

fn read(bytes: &[u8], layout: &Layout, ignored: &[&str]) -> Result<TensorSet> {
    let file =
        SafeTensors::deserialize(bytes).map_err(|e| PolicyError::Safetensors(e.to_string()))?;
    let foreign = file.names().into_iter().map(|n| n.to_string());
    if let Some(name) = foreign
        .filter(|n| !layout.contains_key(n) && !ignored.contains(&n.as_str()))
        .min()
    {
        return Err(PolicyError::UnexpectedTensor(name));
    }
    let mut tensors = TensorSet::new();
    for (name, shape) in layout {
        let view = file
            .tensor(name)
            .map_err(|_| PolicyError::MissingTensor(name.clone()))?;
        if view.dtype() != Dtype::F32 {
            return Err(PolicyError::Dtype {
                name: name.clone(),
                found: format!("{:?}", view.dtype()),
                accepted: "F32",
            });
        }
        if view.shape() != shape {
            return Err(shape_error(name, shape, view.shape()));
        }
        // SafeTensors has checked that the bytes are as many as type and shape ask for.
        let numbers = view
            .data()
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let tensor = TensorData {
            shape: shape.clone(),
            data: numbers.collect(),
        };
        check_finite(name, &tensor)?;
        tensors.insert(name.clone(), tensor);
    }
    Ok(tensors)
}

fn check(tensors: &TensorSet, layout: &Layout) -> Result<()> {
    if let Some(name) = tensors.keys().find(|n| !layout.contains_key(*n)) {
        return Err(PolicyError::UnexpectedTensor(name.clone()));
    }
    for (name, shape) in layout {
        let tensor = tensors
            .get(name)
            .ok_or_else(|| PolicyError::MissingTensor(name.clone()))?;
        if &tensor.shape != shape || tensor.data.len() != shape.iter().product::<usize>() {
            return Err(shape_error(name, shape, &tensor.shape));
        }
        check_finite(name, tensor)?;
    }
    Ok(())
}

pub(crate) fn check_finite(name: &str, tensor: &TensorData) -> Result<()> {
    match tensor.data.iter().position(|x| !x.is_finite()) {
        Some(index) => Err(PolicyError::NotFinite {
            name: name.into(),
            index,
            value: tensor.data[index],
        }),
        None => Ok(()),
    }
}

fn shape_error(name: &str, expected: &[usize], found: &[usize]) -> PolicyError {
    PolicyError::Shape {
        name: name.into(),
        expected: expected.to_vec(),
        found: found.to_vec(),
    }
}

fn write<'a>(tensors: impl Iterator<Item = (&'a String, &'a TensorData)>) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    safetensors_writer::write_to(
        &mut bytes,
        tensors.map(Entry::of).collect(),
        BTreeMap::new(),
    )
    .map_err(|e| PolicyError::Safetensors(e.to_string()))?;
    Ok(bytes)
}
