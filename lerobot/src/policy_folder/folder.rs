//! A policy folder, opened and checked.

use std::path::{Path, PathBuf};

use crate::error::{Result, StoredPolicyError};
use crate::layout::{policy_layout, state_dict_layout, LM_HEAD};
use crate::policy_folder::adapter::Adapter;
use crate::policy_folder::json_file::read_json;
use crate::policy_folder::lerobot_config::LeRobotConfig;
use crate::policy_folder::other_folder;
use crate::policy_folder::processors::{Processors, PREPROCESSOR};
use crate::stored_tensors::StoredTensors;
use zk0_tensors::{check_readable, TensorData, TensorError, TensorSet};

/// The policy's configuration.
pub const CONFIG: &str = "config.json";
/// The VLM's, if needed.
pub const VLM_CONFIG: &str = "vlm_config.json";
/// The weights.
pub const WEIGHTS: &str = "model.safetensors";

/// LeRobot 0.3 kept statistics among the weights, with these prefixes.
const STATISTICS: [&str; 3] = [
    "normalize_inputs.",
    "normalize_targets.",
    "unnormalize_outputs.",
];
/// What `torch.compile` adds to weights' names.
const COMPILED: &str = "_orig_mod.";

/// A policy folder, opened and checked.
#[derive(Debug)]
pub struct PolicyFolder {
    pub(super) folder: PathBuf,
    pub(super) config: LeRobotConfig,
    pub(super) processors: Processors,
    /// The addition to the weights, in an adapter's folder.
    pub(super) adapter: Option<Adapter>,
    pub(super) weights: StoredTensors,
}

impl PolicyFolder {
    /// Opens a folder and checks all but the weights' values.
    ///
    /// # Errors
    /// [`StoredPolicyError::AtPath`] names the file that is missing, unreadable or does not fit.
    pub fn open(folder: impl AsRef<Path>) -> Result<Self> {
        let folder = folder.as_ref().to_path_buf();
        if !folder.is_dir() {
            return Err(StoredPolicyError::file(
                &folder,
                "is not a folder; a policy folder holds config.json and model.safetensors",
            ));
        }
        other_folder::refuse(&folder)?;
        let policy_json = read_json(&folder.join(CONFIG))?;
        let adapter = Adapter::open(&folder, WEIGHTS)?;
        let base = adapter.as_ref().map(|adapter| adapter.base.clone());
        let weights = base.unwrap_or_else(|| folder.join(WEIGHTS));
        let vlm_path = match folder.join(VLM_CONFIG) {
            own if own.exists() => own,
            _ => weights.with_file_name(VLM_CONFIG),
        };
        let vlm_json = if vlm_path.exists() {
            Some(read_json(&vlm_path)?)
        } else {
            None
        };
        let mut config = LeRobotConfig::parse(&policy_json, vlm_json.as_deref())
            .map_err(|e| e.within(&folder.join(CONFIG)))?;
        let processors = Processors::read(&folder)?;
        if let Some(steps) = &processors.before {
            config.dims.rename_map.clone_from(&steps.renames);
            if let Some(tokenizer) = &steps.tokenizer {
                config.dims.max_language_tokens = tokenizer.max_length;
            }
            let checked = config.dims.validate();
            checked.map_err(|e| e.within(&folder.join(PREPROCESSOR)))?;
        }
        let opened = Self {
            processors,
            adapter,
            weights: StoredTensors::open(weights)?,
            folder,
            config,
        };
        opened.check_layout()?;
        Ok(opened)
    }

    /// `config.json`, with the processors' camera and instruction settings.
    pub fn config(&self) -> &LeRobotConfig {
        &self.config
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The weights file as it is; for an adapter, the base's.
    pub fn weights(&self) -> &StoredTensors {
        &self.weights
    }

    /// One tensor of the policy, as `f32`.
    ///
    /// # Errors
    /// It is missing or unreadable, or holds a number that is not finite.
    pub fn tensor(&self, name: &str) -> Result<TensorData> {
        let mut tensor = self.weights.read(self.stored_name(name))?;
        if let Some(adapter) = &self.adapter {
            adapter.apply(name, &mut tensor)?;
        }
        Ok(tensor)
    }

    /// All the policy's tensors as plain `f32`, without the language model's head.
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

    /// PyTorch stores shared tensors once; the metadata has the stored name.
    fn stored_name<'a>(&'a self, name: &'a str) -> &'a str {
        if self.weights.info(name).is_some() {
            return name;
        }
        let metadata = self.weights.metadata().as_ref();
        metadata
            .and_then(|m| m.get(name))
            .map_or(name, String::as_str)
    }

    fn refuse_compiled(&self) -> Result<()> {
        let mut names = self.weights.names().into_iter();
        match names.find(|name| name.contains(COMPILED)) {
            None => Ok(()),
            Some(name) => Err(StoredPolicyError::file(
                self.weights.path(),
                format!(
                    "the weights were saved from a module that torch.compile made, so `{COMPILED}` is in their names (`{name}`). LeRobot \
                     0.6.1 finds none of its own names, and goes on with random weights. Take `{COMPILED}` out of the names: \
                     python -c \"from safetensors.torch import load_file as l, save_file as s; p='{WEIGHTS}'; \
                     s({{k.replace('{COMPILED}', ''): v for k, v in l(p).items()}}, p, {{'format': 'pt'}})\""
                ),
            )),
        }
    }

    fn check_layout(&self) -> Result<()> {
        let path = self.weights.path();
        let layout = state_dict_layout(&self.config.dims);
        for (name, shape) in &layout {
            let Some(info) = self.weights.info(self.stored_name(name)) else {
                if name == LM_HEAD {
                    continue;
                }
                self.refuse_compiled()?;
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
        let mut adapted = self.adapter.iter().flat_map(Adapter::names);
        if let Some(name) = adapted.find(|name| layout.get(*name).is_none_or(|s| s.len() != 2)) {
            let error = StoredPolicyError::from(TensorError::Unexpected(name.clone()));
            return Err(error.within(&self.folder));
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
