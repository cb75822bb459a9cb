//! A recording, as the command line names it.

use anyhow::{bail, Error, Result};
use std::convert::Infallible;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use zk0_lerobot::dataset::{CopiedEpisodes, Dataset, RenameMap};
use zk0_lerobot::hub::{fetch, HubOptions, HubRecording};
use zk0_node::progress::Progress;

/// A LeRobotDataset folder (v2.0, v2.1, v3.0), or `hub:owner/name[@revision]` on the Hugging Face Hub.
#[derive(Clone, Debug)]
pub struct RecordingName(String);

impl FromStr for RecordingName {
    type Err = Infallible;

    fn from_str(name: &str) -> Result<Self, Infallible> {
        Ok(Self(name.to_owned()))
    }
}

impl fmt::Display for RecordingName {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl RecordingName {
    /// The recording's folder. A recording on the Hub is downloaded, unless it is in the Hub's cache already.
    pub fn locate(&self) -> Result<PathBuf> {
        let Some(name) = self.0.strip_prefix("hub:") else {
            return Ok((&self.0).into());
        };
        let name: HubRecording = name.parse()?;
        let options = HubOptions::from_env()?;
        let mut progress = None;
        let fetched = fetch(&name, &options, &mut |at| {
            progress
                .get_or_insert_with(|| Progress::start("downloading", at.of_bytes))
                .reached(at.bytes);
        })?;
        tracing::info!("{name} is commit {}", fetched.commit);
        if let Some(other) = fetched.lerobot_commit {
            tracing::warn!(
                "LeRobot reads commit {other} of it, which the tag v3.0 names; write hub:{}@v3.0 to read that",
                name.repository
            );
        }
        Ok(fetched.folder)
    }

    /// Opens the recording.
    pub fn open(&self) -> Result<Dataset> {
        let opened = self.locate().and_then(|folder| Ok(Dataset::open(folder)?));
        opened.map_err(|error| of_recording(error, self))
    }

    /// Opens recordings that are used together, with their cameras renamed. Episodes that are there twice are warned of.
    pub fn open_together<'a>(
        names: impl IntoIterator<Item = &'a Self>,
        rename_map: &RenameMap,
    ) -> Result<Vec<Dataset>> {
        let opened = names.into_iter().map(Self::open);
        let opened = rename_map.applied(opened.collect::<Result<Vec<_>>>()?)?;
        for copied in CopiedEpisodes::among(&opened) {
            tracing::warn!("{copied}");
        }
        Ok(opened)
    }
}

/// Adds the name of a recording to an error, unless the error has it already: most name a file, and so its folder.
pub fn of_recording(error: Error, recording: impl fmt::Display) -> Error {
    let (name, said) = (recording.to_string(), format!("{error:#}"));
    let folder = name.trim_end_matches('/');
    let is_there = said.match_indices(folder).any(|(at, _)| {
        let (before, after) = (&said[..at], &said[at + folder.len()..]);
        (before.is_empty() || before.ends_with(' ')) && after.starts_with(['/', ':'])
    });
    if is_there {
        error
    } else {
        error.context(format!("recording {name}"))
    }
}

/// Refuses a recording with episodes that were left out: `--whole-recordings`.
pub fn refuse_left_out(dataset: &Dataset) -> Result<()> {
    match dataset.left_out().first() {
        Some(left_out) => {
            bail!("{left_out}. Without --whole-recordings, the other episodes are used")
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_is_named_once() {
        let said = |error: &str, recording: &str| {
            format!(
                "{:#}",
                of_recording(Error::msg(error.to_owned()), recording)
            )
        };
        for (error, recording) in [
            ("nowhere: no such folder", "nowhere"),
            ("my/arm/meta/info.json: missing", "my/arm/"),
            ("episode 1 frame 2: my/arm/videos/a.mp4: cut off", "my/arm"),
        ] {
            assert_eq!(said(error, recording), error);
        }
        for (error, recording) in [
            ("the network is unreachable", "hub:robots/arm"),
            ("the policy takes 5 dimensions", "arm"),
            ("my/arm/meta/info.json: missing", "arm"),
            ("arms/meta/info.json: missing", "arm"),
        ] {
            let expected = format!("recording {recording}: {error}");
            assert_eq!(said(error, recording), expected);
        }
    }

    #[test]
    fn a_folder_that_is_not_there_is_named_once() {
        let name: RecordingName = "no/such/recording".parse().unwrap();
        let said = format!("{:#}", name.open().unwrap_err());
        assert_eq!(said.matches("no/such/recording").count(), 1, "{said}");
    }
}
