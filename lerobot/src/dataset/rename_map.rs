//! Other names for a recording's cameras, like `--rename_map` of LeRobot 0.6.1.

use std::collections::{BTreeMap, BTreeSet};
use std::str::FromStr;

use crate::dataset::{Dataset, DatasetError};
use crate::policy_folder::IMAGES;

const MAX_RENAMED: usize = 64;

/// New camera names by their names in the recording. The start `observation.images.` may be left out.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RenameMap(BTreeMap<String, String>);

impl FromStr for RenameMap {
    type Err = String;

    /// Reads a JSON object such as `{"observation.images.front": "observation.images.top"}`.
    fn from_str(json: &str) -> Result<Self, String> {
        let map: BTreeMap<String, String> = serde_json::from_str(json).map_err(|error| {
            format!(
                "it is no JSON object of names: {error}; write '{{\"observation.images.front\": \"observation.images.top\"}}' to call the camera \
                 front top"
            )
        })?;
        if map.len() > MAX_RENAMED {
            return Err(format!(
                "it renames {} cameras, more than {MAX_RENAMED}",
                map.len()
            ));
        }
        let whole = |(old, new): (String, String)| (whole_name(&old), whole_name(&new));
        Ok(Self(map.into_iter().map(whole).collect()))
    }
}

/// A camera's name with LeRobot's start.
pub fn whole_name(name: &str) -> String {
    if name.starts_with("observation.") {
        name.to_owned()
    } else {
        format!("{IMAGES}{name}")
    }
}

impl RenameMap {
    /// Renames the cameras of recordings that are used together, all at once. A recording may lack some of the map's cameras.
    ///
    /// # Errors
    /// [`DatasetError::NoSuchCamera`] when no recording has a camera of the map (LeRobot ignores this), and [`DatasetError::RenamedAlike`]
    /// when two cameras would get one name.
    pub fn applied(&self, recordings: Vec<Dataset>) -> Result<Vec<Dataset>, DatasetError> {
        let has = |old: &String| {
            let mut cameras = recordings.iter().flat_map(Dataset::cameras);
            cameras.any(|camera| camera.name == *old)
        };
        if let (Some(unknown), Some(first)) =
            (self.0.keys().find(|old| !has(old)), recordings.first())
        {
            return Err(DatasetError::NoSuchCamera {
                path: first.root().into(),
                name: unknown.clone(),
                cameras: first.cameras().iter().map(|c| c.name.clone()).collect(),
            });
        }
        recordings
            .into_iter()
            .map(|recording| recording.with_names_of(self))
            .collect()
    }
}

impl Dataset {
    /// The recording with its cameras renamed.
    ///
    /// # Errors
    /// As [`RenameMap::applied`].
    pub fn renamed(self, map: &RenameMap) -> Result<Self, DatasetError> {
        Ok(map.applied(vec![self])?.remove(0))
    }

    fn with_names_of(mut self, map: &RenameMap) -> Result<Self, DatasetError> {
        let mut taken = BTreeSet::new();
        for camera in &mut self.info.cameras {
            if let Some(new) = map.0.get(&camera.name) {
                camera.name.clone_from(new);
            }
            if !taken.insert(camera.name.clone()) {
                let name = camera.name.clone();
                let path = self.root().to_path_buf();
                return Err(DatasetError::RenamedAlike { path, name });
            }
        }
        Ok(self)
    }
}
