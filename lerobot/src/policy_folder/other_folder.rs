//! LeRobot folders that are mistaken for a policy folder.

use std::path::Path;

use crate::error::{Result, StoredPolicyError};

/// Where a LeRobot checkpoint keeps its policy.
const POLICY: &str = "pretrained_model";
/// Where a run keeps its newest checkpoint.
const LAST: &str = "checkpoints/last";
/// Names the folder's kind if it is known not to be a policy folder.
pub(super) fn refuse(folder: &Path) -> Result<()> {
    let policies = [folder.join(POLICY), folder.join(LAST).join(POLICY)];
    match policies
        .iter()
        .find(|path| path.join("config.json").exists())
    {
        Some(policy) if !folder.join("config.json").exists() => Err(StoredPolicyError::file(
            folder,
            format!(
                "is a checkpoint or a run of lerobot-train, and its policy lies deeper: name {}",
                policy.display()
            ),
        )),
        _ => Ok(()),
    }
}
