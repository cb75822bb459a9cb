//! The statistics that a policy folder normalises states and actions with: where they are, and reading them.

use std::path::{Component, Path};

use serde::Deserialize;

use crate::dataset::{Normalizer, Stats};
use crate::error::{Result, StoredPolicyError};
use crate::policy_folder::folder::{read_json, PolicyFolder, CONFIG};
use crate::policy_folder::inference::{Inference, Normalisation};
use crate::stored_tensors::StoredTensors;

/// A pipeline of LeRobot's processors, as far as needed.
#[derive(Deserialize)]
struct Pipeline {
    steps: Vec<Step>,
}

#[derive(Deserialize)]
struct Step {
    registry_name: Option<String>,
    state_file: Option<String>,
}

/// A feature that is normalised.
pub(super) struct Normalised {
    /// Its name, among a processor's statistics too.
    pub name: &'static str,
    /// LeRobot 0.3 kept the same under these names among the weights; the first is the one that is read.
    pub buffers: &'static [&'static str],
    /// The file of a pipeline.
    pub pipeline: &'static str,
    /// The processor in it.
    pub processor: &'static str,
}

pub(super) const STATE: Normalised = Normalised {
    name: "observation.state",
    buffers: &["normalize_inputs.buffer_observation_state"],
    pipeline: "policy_preprocessor.json",
    processor: "normalizer_processor",
};
pub(super) const ACTION: Normalised = Normalised {
    name: "action",
    buffers: &[
        "unnormalize_outputs.buffer_action",
        "normalize_targets.buffer_action",
    ],
    pipeline: "policy_postprocessor.json",
    processor: "unnormalizer_processor",
};

impl PolicyFolder {
    /// How the policy is used: its Euler steps, and how states and actions are normalised.
    ///
    /// # Errors
    /// As [`Self::stats`].
    pub fn inference(&self) -> Result<Inference> {
        let (state, action) = self.modes()?;
        Ok(Inference {
            num_steps: self.config.num_steps,
            state,
            action,
            stats: self.stats()?,
        })
    }

    /// How states and actions are normalised.
    pub(super) fn modes(&self) -> Result<(Normalisation, Normalisation)> {
        self.config
            .modes()
            .map_err(|e| e.within(&self.folder.join(CONFIG)))
    }

    /// The statistics of states and actions, `None` where the policy folder has none: then those of the recording count.
    ///
    /// # Errors
    /// [`StoredPolicyError::AtPath`] when they are there but cannot be used, and for a normalisation other than by mean and standard
    /// deviation, or none.
    pub fn stats(&self) -> Result<Option<Stats>> {
        let dims = &self.config.dims;
        let modes = self.modes()?;
        let state = self.normalizer(modes.0, &STATE, dims.state_dim)?;
        let action = self.normalizer(modes.1, &ACTION, dims.action_dim)?;
        Ok(match (state, action) {
            (Some(state), Some(action)) => Some(Stats { state, action }),
            _ => None,
        })
    }

    fn normalizer(
        &self,
        mode: Normalisation,
        feature: &Normalised,
        dim: usize,
    ) -> Result<Option<Normalizer>> {
        let name = feature.name;
        if mode == Normalisation::Identity {
            return Ok(Normalizer::identity(dim));
        }
        let path = self.folder.join(feature.pipeline);
        if path.exists() {
            let parsed: Pipeline = serde_json::from_str(&read_json(&path)?)
                .map_err(|e| StoredPolicyError::file(&path, e))?;
            let mut steps = parsed.steps.into_iter();
            let step = steps.find(|step| step.registry_name.as_deref() == Some(feature.processor));
            // A processor without state was saved before it saw a recording.
            let Some(state_file) = step.and_then(|step| step.state_file) else {
                return Ok(None);
            };
            let file = StoredTensors::open(self.folder.join(plain_name(&path, &state_file)?))?;
            return match file.info(&format!("{name}.mean")) {
                Some(_) => read(&file, name, dim).map(Some),
                None => Ok(None),
            };
        }
        let buffer = feature.buffers[0];
        match self.weights.info(&format!("{buffer}.mean")) {
            Some(_) => read(&self.weights, buffer, dim).map(Some),
            None => Ok(None),
        }
    }
}

fn read(file: &StoredTensors, name: &str, dim: usize) -> Result<Normalizer> {
    let values = |what: &str| -> Result<Vec<f32>> {
        let name = format!("{name}.{what}");
        let tensor = file.read(&name)?;
        tensor
            .check_shape(&name, &[dim])
            .map_err(|e| StoredPolicyError::from(e).within(file.path()))?;
        Ok(tensor.data)
    };
    Normalizer::new(values("mean")?, values("std")?).ok_or_else(|| {
        StoredPolicyError::file(file.path(), format!("`{name}.std` holds a number below 0"))
    })
}

/// The name of a file in the folder itself: a pipeline must not lead out of it.
pub(super) fn plain_name<'a>(pipeline: &Path, name: &'a str) -> Result<&'a str> {
    let mut parts = Path::new(name).components();
    match (parts.next(), parts.next()) {
        (Some(Component::Normal(_)), None) => Ok(name),
        _ => Err(StoredPolicyError::file(
            pipeline,
            format!("`state_file` is `{name}`; it must be a file of the same folder"),
        )),
    }
}
