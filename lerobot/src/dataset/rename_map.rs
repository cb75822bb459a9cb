//! Other names for a recording's cameras, as `--rename_map` of LeRobot 0.6.1 gives them.

use std::collections::{BTreeMap, BTreeSet};
use std::str::FromStr;

use crate::dataset::{Dataset, DatasetError};
use crate::policy_folder::IMAGES;

/// Most cameras that a map renames.
const MAX_RENAMED: usize = 64;

/// What cameras are called, by their names in the recording. The common start `observation.images.` may be left out.
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

/// A camera's name with the start that LeRobot gives it.
pub fn whole_name(name: &str) -> String {
    match name.starts_with("observation.") {
        true => name.to_owned(),
        false => format!("{IMAGES}{name}"),
    }
}

impl Dataset {
    /// The same recording with its cameras under other names, all renamed at once. As in LeRobot, a name that no camera has renames nothing; this
    /// warns of it.
    ///
    /// # Errors
    /// [`DatasetError::RenamedAlike`] when two cameras would have one name.
    pub fn renamed(mut self, map: &RenameMap) -> Result<Self, DatasetError> {
        let found: BTreeSet<&str> = self.cameras().iter().map(|c| c.name.as_str()).collect();
        for unknown in map.0.keys().filter(|old| !found.contains(old.as_str())) {
            tracing::warn!(
                "{}: the rename map names {unknown:?}, and the recording's cameras are {found:?}",
                self.root().display()
            );
        }
        let path = self.root().to_path_buf();
        let mut taken = BTreeSet::new();
        for camera in &mut self.info.cameras {
            if let Some(new) = map.0.get(&camera.name) {
                camera.name.clone_from(new);
            }
            if !taken.insert(camera.name.clone()) {
                let name = camera.name.clone();
                return Err(DatasetError::RenamedAlike { path, name });
            }
        }
        Ok(self)
    }
}
