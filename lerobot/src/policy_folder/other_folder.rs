//! Folders that are given for a policy folder, and are another one of LeRobot's.

use std::path::Path;

use crate::error::{Result, StoredPolicyError};

/// Where a run of LeRobot keeps the policy of a checkpoint.
const POLICY: &str = "pretrained_model";
/// Where a whole run keeps its newest checkpoint.
const LAST: &str = "checkpoints/last";
/// States what the folder is, where it is known not to be a policy folder.
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
