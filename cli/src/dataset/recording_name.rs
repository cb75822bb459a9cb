//! A recording's name on the command line.

use anyhow::{bail, Error, Result};
use std::convert::Infallible;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use zk0_lerobot::dataset::{CopiedEpisodes, Dataset, RenameMap};
use zk0_lerobot::hub::{fetch, Fetched, HubOptions, HubRecording};
use zk0_node::progress::Progress;
use zk0_node::recording::registering::has_registered;
use zk0_node::state_files;

/// A LeRobotDataset folder (v2.0, v2.1, v3.0), or `hub:owner/name[@revision]` on the Hugging Face Hub.
#[derive(Clone, Debug)]
pub struct RecordingName(String);

/// The Hub commit of a node's recording.
const COMMIT_FILE: &str = "recording-commit.json";

const MAX_COMMIT_BYTES: u64 = 4 << 10;

#[derive(serde::Deserialize, serde::Serialize)]
struct NodeCommit {
    /// As the operator named it.
    recording: String,
    commit: String,
}

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
    /// The recording's folder, downloaded unless it is in the cache.
    pub fn locate(&self) -> Result<PathBuf> {
        match self.on_hub()? {
            Some(name) => Ok(fetched(&name, &HubOptions::from_env()?)?.folder),
            None => Ok((&self.0).into()),
        }
    }

    /// The recording's folder for a node. A registered node keeps the Hub commit in `state`, and does not ask the Hub again.
    pub fn locate_for_node(&self, state: &Path) -> Result<PathBuf> {
        match self.on_hub()? {
            Some(name) => kept(name, state, &HubOptions::from_env()?),
            None => Ok((&self.0).into()),
        }
    }

    fn on_hub(&self) -> Result<Option<HubRecording>> {
        let name = self.0.strip_prefix("hub:");
        Ok(name.map(str::parse).transpose()?)
    }

    /// Opens the recording.
    pub fn open(&self) -> Result<Dataset> {
        let opened = self.locate().and_then(|folder| Ok(Dataset::open(folder)?));
        opened.map_err(|error| of_recording(error, self))
    }

    /// Opens recordings together, with renamed cameras. Warns of repeated episodes.
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

fn kept(name: HubRecording, state: &Path, options: &HubOptions) -> Result<PathBuf> {
    let path = state.join(COMMIT_FILE);
    let named = name.to_string();
    let last: Option<NodeCommit> = state_files::read_json(&path, MAX_COMMIT_BYTES)?;
    let last = last.filter(|last| last.recording == named && has_registered(state));
    if let Some(NodeCommit { commit, .. }) = last {
        tracing::info!(
            "the node has registered commit {commit} of {named}, and stays with it; to take another one, write hub:{}@COMMIT",
            name.repository
        );
        let registered = HubRecording {
            revision: commit,
            ..name
        };
        return Ok(fetched(&registered, options)?.folder);
    }
    let Fetched { folder, commit, .. } = fetched(&name, options)?;
    let recording = named;
    state_files::write_json(&path, &NodeCommit { recording, commit })?;
    Ok(folder)
}

fn fetched(name: &HubRecording, options: &HubOptions) -> Result<Fetched> {
    let mut progress = None;
    let fetched = fetch(name, options, &mut |at| {
        progress
            .get_or_insert_with(|| Progress::start("downloading", at.of_bytes))
            .reached(at.bytes);
    })?;
    tracing::info!("{name} is commit {}", fetched.commit);
    if let Some(other) = &fetched.lerobot_commit {
        tracing::warn!(
            "LeRobot reads commit {other} of it, which the tag v3.0 names; write hub:{}@v3.0 to read that",
            name.repository
        );
    }
    Ok(fetched)
}

/// Adds a recording's name to an error that lacks it. Most errors name a file in its folder.
pub fn of_recording(error: Error, recording: impl fmt::Display) -> Error {
    let (name, reported) = (recording.to_string(), format!("{error:#}"));
    let folder = name.trim_end_matches('/');
    let is_there = reported.match_indices(folder).any(|(at, _)| {
        let (before, after) = (&reported[..at], &reported[at + folder.len()..]);
        (before.is_empty() || before.ends_with(' ')) && after.starts_with(['/', ':'])
    });
    if is_there {
        error
    } else {
        error.context(format!("recording {name}"))
    }
}

/// `--whole-recordings`: refuses a recording with left-out episodes.
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
    use std::fs;

    #[test]
    fn a_recording_is_named_once() {
        let reported = |error: &str, recording: &str| {
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
            assert_eq!(reported(error, recording), error);
        }
        for (error, recording) in [
            ("the network is unreachable", "hub:robots/arm"),
            ("the policy takes 5 dimensions", "arm"),
            ("my/arm/meta/info.json: missing", "arm"),
            ("arms/meta/info.json: missing", "arm"),
        ] {
            let expected = format!("recording {recording}: {error}");
            assert_eq!(reported(error, recording), expected);
        }
    }

    #[test]
    fn a_folder_that_is_not_there_is_named_once() {
        let name: RecordingName = "no/such/recording".parse().unwrap();
        let reported = format!("{:#}", name.open().unwrap_err());
        assert_eq!(
            reported.matches("no/such/recording").count(),
            1,
            "{reported}"
        );
    }

    #[test]
    fn a_node_stays_with_the_commit_that_it_has_registered() {
        let (cache, state) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        // The Hub cannot be reached. The cache is complete.
        let options = HubOptions {
            endpoint: "http://127.0.0.1:1".into(),
            token: None,
            cache: cache.path().into(),
        };
        let repository = cache.path().join("datasets--robots--arm");
        let commits = ["0a", "0b"].map(|digits| digits.repeat(20));
        let is_at = |revision: &str, commit: &str| {
            let reference = repository.join("refs").join(revision);
            fs::create_dir_all(reference.parent().unwrap()).unwrap();
            fs::write(reference, commit).unwrap();
        };
        for commit in &commits {
            let meta = repository.join("snapshots").join(commit).join("meta");
            fs::create_dir_all(&meta).unwrap();
            fs::write(meta.join("info.json"), "{}").unwrap();
            is_at(commit, commit);
        }
        let found = |name: &str| {
            let folder = kept(name.parse().unwrap(), state.path(), &options).unwrap();
            folder.file_name().unwrap().to_str().unwrap().to_owned()
        };
        is_at("main", &commits[0]);
        assert_eq!(found("robots/arm"), commits[0]);
        // Nothing is registered yet: the node follows the branch.
        is_at("main", &commits[1]);
        assert_eq!(found("robots/arm"), commits[1]);
        fs::write(state.path().join("registration"), "").unwrap();
        is_at("main", &commits[0]);
        assert_eq!(found("robots/arm"), commits[1]);
        let named = format!("robots/arm@{}", commits[0]);
        assert_eq!(found(&named), commits[0]);
        assert_eq!(found("robots/arm@main"), commits[0]);
    }
}
