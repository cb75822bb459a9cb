//! `lerobot/` in a run's folder: the initial LeRobot policy folder with the trained weights.

use crate::policy::{whole_folder, PolicySource};
use anyhow::{bail, Result};
use std::path::{Path, PathBuf};
use zk0_lerobot::dataset::Stats;
use zk0_lerobot::policy_folder::Precision;
use zk0_tensors::TensorSet;

const FOLDER: &str = "lerobot";

/// Checks before the first step that the folder can be written.
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
    // This folder could be another run's.
    if !resumes && folder.exists() {
        bail!(
            "{} exists already: add --resume to go on with the run that wrote it, or choose another --out",
            folder.display()
        );
    }
    Ok(())
}

/// Writes or replaces the folder, whole or not at all. `None` if the run did not start from a LeRobot policy folder.
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
