//! Where a recording is: in a folder, or on the Hub and then in its cache.

use anyhow::Result;
use std::path::PathBuf;
use zk0_prover::progress::Progress;
use zk0_smolvla::hub::{fetch, HubOptions, HubRecording};

/// The recording's folder. `hub:owner/name[@revision]` is downloaded as far as it is not in the cache; anything else is a folder.
pub fn locate(recording: &str) -> Result<PathBuf> {
    let Some(name) = recording.strip_prefix("hub:") else {
        return Ok(recording.into());
    };
    let name: HubRecording = name.parse()?;
    let options = HubOptions::from_env()?;
    let mut progress = None;
    let folder = fetch(&name, &options, &mut |at| {
        progress
            .get_or_insert_with(|| Progress::start("downloading", at.of_bytes))
            .reached(at.bytes);
    })?;
    Ok(folder)
}
