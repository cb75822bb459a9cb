//! The statistics that a checkpoint normalises states and actions with.

use std::path::{Component, Path};

use serde::Deserialize;

use super::{read_json, Checkpoint};
use crate::dataset::{Normalizer, Stats};
use crate::error::{PolicyError, Result};
use crate::safetensors_file::TensorFile;

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

impl Checkpoint {
    /// The statistics of states and actions, `None` where the checkpoint has none: then those of the recording count.
    ///
    /// # Errors
    /// [`PolicyError::AtPath`] when they are there but cannot be used, and [`PolicyError::Config`] for a normalisation other than
    /// by mean and standard deviation, or none.
    pub fn stats(&self) -> Result<Option<Stats>> {
        let (c, dims) = (&self.config, &self.config.dims);
        let state = self.normalizer(
            &c.state_normalisation,
            ("observation.state", dims.state_dim),
            ("policy_preprocessor.json", "normalizer_processor"),
            "normalize_inputs.buffer_observation_state",
        )?;
        let action = self.normalizer(
            &c.action_normalisation,
            ("action", dims.action_dim),
            ("policy_postprocessor.json", "unnormalizer_processor"),
            "unnormalize_outputs.buffer_action",
        )?;
        Ok(match (state, action) {
            (Some(state), Some(action)) => Some(Stats { state, action }),
            _ => None,
        })
    }

    /// `feature` is a name and its dimensions, `pipeline` a file and the processor in it, `buffer` where LeRobot 0.3 kept the
    /// same among the weights.
    fn normalizer(
        &self,
        mode: &str,
        feature: (&str, usize),
        pipeline: (&str, &str),
        buffer: &str,
    ) -> Result<Option<Normalizer>> {
        let (name, dim) = feature;
        if mode == "IDENTITY" {
            return Ok(Normalizer::new(vec![0.0; dim], vec![1.0; dim]));
        }
        if mode != "MEAN_STD" {
            return Err(PolicyError::Config(format!(
                "`{name}` is normalised by `{mode}`; only `MEAN_STD` and `IDENTITY` are implemented"
            )));
        }
        let path = self.folder.join(pipeline.0);
        if path.exists() {
            let parsed: Pipeline = serde_json::from_str(&read_json(&path)?)
                .map_err(|e| PolicyError::file(&path, e))?;
            let mut steps = parsed.steps.into_iter();
            let step = steps.find(|step| step.registry_name.as_deref() == Some(pipeline.1));
            // A processor without state was saved before it saw a recording.
            let Some(state_file) = step.and_then(|step| step.state_file) else {
                return Ok(None);
            };
            let file = TensorFile::open(self.folder.join(plain_name(&path, &state_file)?))?;
            return match file.info(&format!("{name}.mean")) {
                Some(_) => read(&file, name, dim).map(Some),
                None => Ok(None),
            };
        }
        match self.weights.info(&format!("{buffer}.mean")) {
            Some(_) => read(&self.weights, buffer, dim).map(Some),
            None => Ok(None),
        }
    }
}

fn read(file: &TensorFile, name: &str, dim: usize) -> Result<Normalizer> {
    let values = |what: &str| -> Result<Vec<f32>> {
        let name = format!("{name}.{what}");
        let tensor = file.read(&name)?;
        if tensor.shape != [dim] {
            let error = PolicyError::Shape {
                name,
                expected: vec![dim],
                found: tensor.shape,
            };
            return Err(error.within(file.path()));
        }
        Ok(tensor.data)
    };
    Normalizer::new(values("mean")?, values("std")?).ok_or_else(|| {
        PolicyError::file(file.path(), format!("`{name}.std` holds a number below 0"))
    })
}

/// The name of a file in the folder itself: a pipeline must not lead out of it.
fn plain_name<'a>(pipeline: &Path, name: &'a str) -> Result<&'a str> {
    let mut parts = Path::new(name).components();
    match (parts.next(), parts.next()) {
        (Some(Component::Normal(_)), None) => Ok(name),
        _ => Err(PolicyError::file(
            pipeline,
            format!("`state_file` is `{name}`; it must be a file of the same folder"),
        )),
    }
}
