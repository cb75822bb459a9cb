//! A policy's weights as plain numbers: frozen half and expert. Reading checks names, shapes, types and finite numbers. Equal weights give
//! equal bytes.

use std::collections::BTreeMap;

use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::layout::{expert_layout, policy_layout, LM_HEAD};
use zk0_lerobot::policy_folder::PolicyFolder;
use zk0_tensors::{
    check_layout, write_to, TensorData, TensorEntry, TensorError, TensorFile, TensorSet,
    HEADER_LIMIT,
};

use crate::error::Result;

/// The tensors that training changes and nodes exchange: the expert's layers and final norm, and the action and time projections. Complete,
/// well-shaped and finite.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpertWeights(TensorSet);

impl ExpertWeights {
    /// Reads a safetensors file with exactly the expert's tensors.
    ///
    /// # Errors
    /// The tensor that is missing, unexpected, of another shape or type, or not finite.
    pub fn from_safetensors(config: &PolicyConfig, bytes: &[u8]) -> Result<Self> {
        let file = TensorFile::open(bytes, HEADER_LIMIT)?;
        Ok(Self(file.read_exactly(&expert_layout(config), &[])?))
    }

    /// Takes tensors, with the same checks.
    pub fn from_tensors(config: &PolicyConfig, tensors: TensorSet) -> Result<Self> {
        check_layout(&tensors, &expert_layout(config))?;
        Ok(Self(tensors))
    }

    /// A safetensors file's bytes.
    pub fn to_safetensors(&self) -> Result<Vec<u8>> {
        write(self.0.iter())
    }

    /// The tensors in name order.
    pub fn tensors(&self) -> &TensorSet {
        &self.0
    }

    /// Returns the tensors.
    pub fn into_tensors(self) -> TensorSet {
        self.0
    }
}

/// A whole policy.
#[derive(Clone, Debug, PartialEq)]
pub struct Policy {
    /// Its dimensions.
    pub config: PolicyConfig,
    /// Vision tower, connector, language layers and state projection.
    pub frozen: TensorSet,
    /// The trainable half.
    pub expert: ExpertWeights,
}

impl Policy {
    /// Reads LeRobot's `policy.state_dict()` as safetensors bytes, with or without the unused `lm_head`.
    ///
    /// # Errors
    /// Those of [`ExpertWeights::from_safetensors`].
    pub fn from_safetensors(config: &PolicyConfig, bytes: &[u8]) -> Result<Self> {
        config.validate()?;
        let file = TensorFile::open(bytes, HEADER_LIMIT)?;
        let all = file.read_exactly(&policy_layout(config), &[LM_HEAD])?;
        Ok(Self::split(config, all))
    }

    /// Reads a policy folder's weights.
    ///
    /// # Errors
    /// Those of [`PolicyFolder::tensors`].
    pub fn from_folder(folder: &PolicyFolder) -> Result<Self> {
        Ok(Self::split(&folder.config().dims, folder.tensors()?))
    }

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

    /// All tensors: frozen ones in name order, then the expert's.
    pub fn tensors(&self) -> impl Iterator<Item = (&String, &TensorData)> {
        self.frozen.iter().chain(&self.expert.0)
    }

    /// A safetensors file's bytes with LeRobot's names.
    pub fn to_safetensors(&self) -> Result<Vec<u8>> {
        write(self.tensors())
    }
}

fn write<'a>(tensors: impl Iterator<Item = (&'a String, &'a TensorData)>) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    write_to(
        &mut bytes,
        tensors.map(TensorEntry::of).collect(),
        BTreeMap::new(),
    )
    .map_err(TensorError::from)?;
    Ok(bytes)
}
