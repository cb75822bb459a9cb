//! A policy as LeRobot's `save_pretrained` leaves it: a folder with
//!
//! ```text
//! config.json                                    dimensions, features, training preset (LeRobotConfig)
//! model.safetensors                              the state dict; F32, F16 and BF16 are read
//! policy_preprocessor.json  + .safetensors       from LeRobot 0.4 on: normalisation of states, with its statistics
//! policy_postprocessor.json + .safetensors       and of actions. LeRobot 0.3 kept them in the state dict.
//! vlm_config.json                                not LeRobot's: the VLM's config.json, where its name is not a known one
//! ```
//!
//! [`Checkpoint::open`] checks names, shapes and types against the layout that follows from the configuration, without reading
//! a single weight. [`Checkpoint::write`] leaves a folder that LeRobot loads, in which nothing differs but the weights that it
//! was given; [`Checkpoint::write_trained`] one with a recording's statistics besides.

mod other_stats;
mod stats;
mod write;

use std::fs;
use std::path::{Path, PathBuf};

use candle_core::{Device, Tensor};

use crate::error::{PolicyError, Result};
use crate::layout::{checkpoint_layout, policy_layout, LM_HEAD};
use crate::lerobot_config::LeRobotConfig;
use crate::model::Parameters;
use crate::safetensors_file::{readable_size, TensorFile};
use crate::weights::{Policy, TensorData, TensorSet};

pub use write::Precision;

/// The policy's configuration.
pub const CONFIG: &str = "config.json";
/// The VLM's, where needed.
pub const VLM_CONFIG: &str = "vlm_config.json";
/// The weights.
pub const WEIGHTS: &str = "model.safetensors";

/// LeRobot 0.3 kept statistics among the weights, under names that begin so.
const STATISTICS: [&str; 3] = [
    "normalize_inputs.",
    "normalize_targets.",
    "unnormalize_outputs.",
];
/// A JSON file this long is none of LeRobot's.
const JSON_LIMIT: u64 = 16 << 20;

/// An opened folder.
#[derive(Debug)]
pub struct Checkpoint {
    folder: PathBuf,
    config: LeRobotConfig,
    weights: TensorFile,
}

impl Checkpoint {
    /// Opens a folder and checks all but the weights' values.
    ///
    /// # Errors
    /// [`PolicyError::AtPath`], with the path of the file that is missing, cannot be read, or does not fit the others.
    pub fn open(folder: impl AsRef<Path>) -> Result<Self> {
        let folder = folder.as_ref().to_path_buf();
        if !folder.is_dir() {
            return Err(PolicyError::file(
                &folder,
                "is not a folder; a checkpoint is one with config.json and model.safetensors",
            ));
        }
        let policy_json = read_json(&folder.join(CONFIG))?;
        let vlm_path = folder.join(VLM_CONFIG);
        let vlm_json = match vlm_path.exists() {
            true => Some(read_json(&vlm_path)?),
            false => None,
        };
        let config = LeRobotConfig::parse(&policy_json, vlm_json.as_deref())
            .map_err(|e| e.within(&folder.join(CONFIG)))?;
        let checkpoint = Self {
            weights: TensorFile::open(folder.join(WEIGHTS))?,
            folder,
            config,
        };
        checkpoint.check_layout()?;
        Ok(checkpoint)
    }

    /// What `config.json` says.
    pub fn config(&self) -> &LeRobotConfig {
        &self.config
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The file of the weights, as it is.
    pub fn weights(&self) -> &TensorFile {
        &self.weights
    }

    /// One tensor of the policy, as `f32`.
    ///
    /// # Errors
    /// When it is not there, holds a number that is not finite, or reading fails.
    pub fn tensor(&self, name: &str) -> Result<TensorData> {
        self.weights.read(self.stored_name(name))
    }

    /// All weights of the policy as plain `f32`, without the language model's head.
    ///
    /// # Errors
    /// As [`Self::tensor`].
    pub fn policy(&self) -> Result<Policy> {
        let names = policy_layout(&self.config.dims).into_keys();
        let all = names
            .map(|name| {
                let tensor = self.tensor(&name)?;
                Ok((name, tensor))
            })
            .collect::<Result<TensorSet>>()?;
        Ok(Policy::split(&self.config.dims, all))
    }

    /// All weights of the policy on a device, in `f32`. One tensor at a time passes through memory, so on the CPU this takes
    /// the policy's size and no more.
    ///
    /// # Errors
    /// As [`Self::tensor`].
    pub fn parameters(&self, device: &Device) -> Result<Parameters> {
        let names = policy_layout(&self.config.dims).into_keys();
        let all = names.map(|name| {
            let tensor = self.tensor(&name)?;
            Ok((name, Tensor::from_vec(tensor.data, tensor.shape, device)?))
        });
        Ok(Parameters::from_tensors(all.collect::<Result<_>>()?))
    }

    /// PyTorch stores tensors that share their memory once; the metadata says under which name.
    fn stored_name<'a>(&'a self, name: &'a str) -> &'a str {
        if self.weights.info(name).is_some() {
            return name;
        }
        let metadata = self.weights.metadata().as_ref();
        metadata
            .and_then(|m| m.get(name))
            .map_or(name, String::as_str)
    }

    fn check_layout(&self) -> Result<()> {
        let path = self.weights.path();
        let layout = checkpoint_layout(&self.config.dims);
        for (name, shape) in &layout {
            let Some(info) = self.weights.info(self.stored_name(name)) else {
                if name == LM_HEAD {
                    continue;
                }
                return Err(PolicyError::MissingTensor(name.clone()).within(path));
            };
            if &info.shape != shape {
                let error = PolicyError::Shape {
                    name: name.clone(),
                    expected: shape.clone(),
                    found: info.shape.clone(),
                };
                return Err(error.within(path));
            }
            if readable_size(info.dtype).is_none() {
                return Err(self.weights.unreadable(name, info.dtype));
            }
        }
        let known = |name: &String| {
            layout.contains_key(name) || STATISTICS.iter().any(|start| name.starts_with(start))
        };
        match self.weights.names().into_iter().find(|name| !known(name)) {
            Some(name) => Err(PolicyError::UnexpectedTensor(name).within(path)),
            None => Ok(()),
        }
    }
}

/// A text file of a checkpoint.
fn read_json(path: &Path) -> Result<String> {
    let failed = |e: std::io::Error| PolicyError::file(path, e);
    let length = fs::metadata(path).map_err(failed)?.len();
    if length > JSON_LIMIT {
        return Err(PolicyError::file(
            path,
            format!("has {length} bytes; no such JSON file has more than {JSON_LIMIT}"),
        ));
    }
    fs::read_to_string(path).map_err(failed)
}
