//! The statistics that normalise a policy folder's states and actions: finds and reads them.

use std::path::{Component, Path};

use crate::dataset::{Normalizer, Stats};
use crate::error::{Result, StoredPolicyError};
use crate::policy_folder::folder::{PolicyFolder, CONFIG};
use crate::policy_folder::inference::{Inference, Normalisation};
use crate::policy_folder::processors::{
    Steps, NORMALIZER, POSTPROCESSOR, PREPROCESSOR, UNNORMALIZER,
};
use crate::stored_tensors::StoredTensors;

pub(super) struct Normalised {
    /// Its name, also in processors' statistics.
    pub name: &'static str,
    /// Its names in LeRobot 0.3's weights; the first is read.
    pub buffers: &'static [&'static str],
    /// LeRobot's name of its kind.
    pub kind: &'static str,
    /// The pipeline's file.
    pub pipeline: &'static str,
    pub processor: &'static str,
}

pub(super) const STATE: Normalised = Normalised {
    name: "observation.state",
    buffers: &["normalize_inputs.buffer_observation_state"],
    kind: "STATE",
    pipeline: PREPROCESSOR,
    processor: NORMALIZER,
};
pub(super) const ACTION: Normalised = Normalised {
    name: "action",
    buffers: &[
        "unnormalize_outputs.buffer_action",
        "normalize_targets.buffer_action",
    ],
    kind: "ACTION",
    pipeline: POSTPROCESSOR,
    processor: UNNORMALIZER,
};

impl PolicyFolder {
    /// How the policy is used: Euler steps, and normalisation of states and actions.
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

    /// How states and actions are normalised: by the processors, else by `config.json`.
    pub(super) fn modes(&self) -> Result<(Normalisation, Normalisation)> {
        let (before, behind) = (&self.processors.before, &self.processors.behind);
        let state = self.mode(before.as_ref(), &STATE, PREPROCESSOR)?;
        let trained = self.mode(before.as_ref(), &ACTION, PREPROCESSOR)?;
        let action = self.mode(behind.as_ref(), &ACTION, POSTPROCESSOR)?;
        if before.is_some() && behind.is_some() && trained != action {
            return Err(StoredPolicyError::file(
                &self.folder,
                format!(
                    "{PREPROCESSOR} normalises `{}` by `{}`, and {POSTPROCESSOR} brings it back by `{}`: LeRobot trains on other actions \
                     than it gives to the robot; make both files tell the same",
                    ACTION.name,
                    trained.name(),
                    action.name()
                ),
            ));
        }
        Ok((state, action))
    }

    fn mode(
        &self,
        steps: Option<&Steps>,
        feature: &Normalised,
        pipeline: &str,
    ) -> Result<Normalisation> {
        let reported = match steps.map(|steps| &steps.normalizer) {
            None => None,
            // LeRobot follows the steps, and none normalises.
            Some(None) => Some(Normalisation::Identity),
            Some(Some(step)) => step
                .mode(feature.name, feature.kind)
                .map_err(|e| e.within(&self.folder.join(pipeline)))?,
        };
        match reported {
            Some(mode) => Ok(mode),
            None => self
                .config
                .mode(feature.kind, feature.name)
                .map_err(|e| e.within(&self.folder.join(CONFIG))),
        }
    }

    /// The statistics of states and actions; `None` where the folder has none: the recording's then count.
    ///
    /// # Errors
    /// [`StoredPolicyError::AtPath`] when they are unusable, or the normalisation is neither by mean and standard deviation nor none.
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

    /// Refuses a folder whose processors normalise without statistics of states and actions: LeRobot would silently leave both as they are,
    /// and a robot take numbers around 1 for degrees.
    ///
    /// # Errors
    /// [`StoredPolicyError::AtPath`] names the existing statistics; and those of [`Self::stats`].
    pub fn check_has_statistics(&self) -> Result<()> {
        let Some(step) = self.steps(&ACTION) else {
            // LeRobot 0.4 and later do not load such a folder; 0.3 reports missing statistics.
            return Ok(());
        };
        if self.stats()?.is_some() {
            return Ok(());
        }
        let state_file = step
            .normalizer
            .as_ref()
            .and_then(|step| step.state_file.as_ref());
        let found = match state_file {
            None => Vec::new(),
            Some(name) => StoredTensors::open(self.folder.join(name))?.names(),
        };
        let mut found: Vec<_> = found
            .iter()
            .filter_map(|name| name.strip_suffix(".mean"))
            .collect();
        found.truncate(8);
        Err(StoredPolicyError::file(
            &self.folder,
            format!(
                "the processors normalise `{}` and `{}`, and have no statistics of them{}. LeRobot would leave states and actions as they are, \
                 without a word, and a robot would take numbers around 1 for degrees",
                STATE.name,
                ACTION.name,
                if found.is_empty() { String::new() } else { format!(" (only of `{}`)", found.join("`, `")) }
            ),
        ))
    }

    pub(super) fn steps(&self, feature: &Normalised) -> Option<&Steps> {
        match feature.pipeline {
            PREPROCESSOR => self.processors.before.as_ref(),
            _ => self.processors.behind.as_ref(),
        }
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
        if let Some(steps) = self.steps(feature) {
            // A processor without state was saved before any recording.
            let step = steps.normalizer.as_ref();
            let Some(state_file) = step.and_then(|step| step.state_file.as_ref()) else {
                return Ok(None);
            };
            let path = self.folder.join(feature.pipeline);
            let file = StoredTensors::open(self.folder.join(plain_name(&path, state_file)?))?;
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

/// The name of a file in the folder: a pipeline must not lead outside.
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
