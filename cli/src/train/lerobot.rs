//! `lerobot/` in the folder of a run: the LeRobot policy folder that the run started from, with the trained weights. LeRobot's
//! `from_pretrained` loads it.

use crate::policy::{whole_folder, PolicySource};
use anyhow::{bail, Result};
use std::path::{Path, PathBuf};
use zk0_lerobot::dataset::Stats;
use zk0_lerobot::policy_folder::Precision;
use zk0_tensors::TensorSet;

/// Its name in the run's folder.
const FOLDER: &str = "lerobot";

/// Checks before the first step that the folder can be written after the last one.
pub fn check(source: &PolicySource, out: &Path, stats: &Stats, resumes: bool) -> Result<()> {
    let Some(policy_folder) = source.lerobot()? else {
        return Ok(());
    };
    policy_folder.check_takes(stats)?;
    let folder = out.join(FOLDER);
    let real = |path: &Path| path.canonicalize().ok();
    let started_from = real(policy_folder.folder());
    if [out, &folder].iter().any(|path| real(path) == started_from) {
        bail!(
            "results in {} would replace the policy that the run starts from: choose another --out",
            out.display()
        );
    }
    // A run that goes on replaces its own folder. This one could belong to another run.
    if !resumes && folder.exists() {
        bail!(
            "{} exists already: add --resume to go on with the run that wrote it, or choose another --out",
            folder.display()
        );
    }
    Ok(())
}

/// Writes the folder, whole or not at all. It replaces the folder that the run has written before. `None` if the run did not start from a
/// LeRobot policy folder.
pub fn write(
    source: &PolicySource,
    out: &Path,
    trained: &TensorSet,
    stats: &Stats,
    precision: Precision,
) -> Result<Option<PathBuf>> {
    let Some(policy_folder) = source.lerobot()? else {
        return Ok(None);
    };
    let write = |to: &Path| Ok(policy_folder.write_trained(to, trained, stats, precision)?);
    Ok(Some(whole_folder::write(out, FOLDER, write)?))
}
