//! The `tokenizer.json` for a policy folder's instructions: its own, or that of the repository it names, which LeRobot takes from the Hub
//! or its cache.

use std::path::{Path, PathBuf};

use hf_hub::Cache;

use crate::error::{Result, StoredPolicyError};
use crate::policy_folder::folder::{PolicyFolder, CONFIG};
use crate::policy_folder::processors::PREPROCESSOR;

const FILE: &str = "tokenizer.json";

impl PolicyFolder {
    /// The file, with the Hub's cache in the folder `cache`. `None` where the folder neither holds nor names one.
    ///
    /// # Errors
    /// [`StoredPolicyError::AtPath`] where the named one is not on this machine: other tokens would change the instructions.
    pub fn tokenizer_file(&self, cache: Option<&Path>) -> Result<Option<PathBuf>> {
        let own = self.folder.join(FILE);
        if own.exists() {
            return Ok(Some(own));
        }
        let Some((said_by, name)) = self.tokenizer_name() else {
            return Ok(None);
        };
        // As in LeRobot, the name may be a folder's.
        let beside = Path::new(name).join(FILE);
        let in_cache = || Cache::new(cache?.into()).model(name.into()).get(FILE);
        let found = beside.exists().then_some(beside).or_else(in_cache);
        match found {
            Some(file) => Ok(Some(file)),
            None => Err(StoredPolicyError::file(
                &self.folder,
                format!(
                    "has no {FILE}, and {said_by} names the tokenizer of `{name}`, which the Hub's cache{} does not hold. LeRobot fetches it. Run \
                     `hf download {name} {FILE}`, or copy that file into the folder",
                    cache.map_or(String::new(), |path| format!(" {}", path.display()))
                ),
            )),
        }
    }

    /// The tokenizer's name and the file with it: the step that reads instructions, in LeRobot 0.3 the configuration.
    fn tokenizer_name(&self) -> Option<(&str, &str)> {
        let steps = self.processors.before.as_ref();
        let step = steps.and_then(|steps| steps.tokenizer.as_ref());
        let step = step.and_then(|step| Some((PREPROCESSOR, step.name.as_deref()?)));
        let vlm = &self.config.vlm_model_name;
        // A repository's name has an owner; others cannot be looked up.
        step.or_else(|| vlm.contains('/').then_some((CONFIG, vlm)))
    }
}
