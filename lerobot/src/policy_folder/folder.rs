//! A policy folder, opened and checked.

use std::fs;
use std::path::{Path, PathBuf};

use crate::error::{Result, StoredPolicyError};
use crate::layout::{policy_layout, state_dict_layout, LM_HEAD};
use crate::policy_folder::lerobot_config::LeRobotConfig;
use crate::stored_tensors::StoredTensors;
use zk0_tensors::{check_readable, TensorData, TensorError, TensorSet};

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
/// The largest JSON file that is read. LeRobot's are far smaller.
const JSON_LIMIT: u64 = 16 << 20;

/// A policy folder, opened and checked.
#[derive(Debug)]
pub struct PolicyFolder {
    pub(super) folder: PathBuf,
    pub(super) config: LeRobotConfig,
    pub(super) weights: StoredTensors,
}

impl PolicyFolder {
    /// Opens a folder and checks all but the weights' values.
    ///
    /// # Errors
    /// [`StoredPolicyError::AtPath`], with the path of the file that is missing, cannot be read, or does not fit the others.
    pub fn open(folder: impl AsRef<Path>) -> Result<Self> {
        let folder = folder.as_ref().to_path_buf();
        if !folder.is_dir() {
            return Err(StoredPolicyError::file(
                &folder,
                "is not a folder; a policy folder holds config.json and model.safetensors",
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
        let opened = Self {
            weights: StoredTensors::open(folder.join(WEIGHTS))?,
            folder,
            config,
        };
        opened.check_layout()?;
        Ok(opened)
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
    pub fn weights(&self) -> &StoredTensors {
        &self.weights
    }

    /// One tensor of the policy, as `f32`.
    ///
    /// # Errors
    /// When it is not there, holds a number that is not finite, or reading fails.
    pub fn tensor(&self, name: &str) -> Result<TensorData> {
        self.weights.read(self.stored_name(name))
    }

    /// All tensors of the policy as plain `f32`, without the language model's head.
    ///
    /// # Errors
    /// As [`Self::tensor`].
    pub fn tensors(&self) -> Result<TensorSet> {
        let names = policy_layout(&self.config.dims).into_keys();
        let read = |name: String| {
            let tensor = self.tensor(&name)?;
            Ok((name, tensor))
        };
        names.map(read).collect()
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
        let layout = state_dict_layout(&self.config.dims);
        for (name, shape) in &layout {
            let Some(info) = self.weights.info(self.stored_name(name)) else {
                if name == LM_HEAD {
                    continue;
                }
                return Err(
                    StoredPolicyError::from(TensorError::Missing(name.clone())).within(path)
                );
            };
            if &info.shape != shape {
                let error = TensorError::Shape {
                    name: name.clone(),
                    expected: shape.clone(),
                    found: info.shape.clone(),
                };
                return Err(StoredPolicyError::from(error).within(path));
            }
            check_readable(name, info.dtype)
                .map_err(|e| StoredPolicyError::from(e).within(path))?;
        }
        let known = |name: &String| {
            layout.contains_key(name) || STATISTICS.iter().any(|start| name.starts_with(start))
        };
        match self.weights.names().into_iter().find(|name| !known(name)) {
            Some(name) => Err(StoredPolicyError::from(TensorError::Unexpected(name)).within(path)),
            None => Ok(()),
        }
    }
}

/// Reads a JSON file of a policy folder.
pub(super) fn read_json(path: &Path) -> Result<String> {
    let failed = |e: std::io::Error| StoredPolicyError::file(path, e);
    let length = fs::metadata(path).map_err(failed)?.len();
    if length > JSON_LIMIT {
        return Err(StoredPolicyError::file(
            path,
            format!("has {length} bytes; no such JSON file has more than {JSON_LIMIT}"),
        ));
    }
    fs::read_to_string(path).map_err(failed)
}
