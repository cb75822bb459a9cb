//! A recording, opened and checked.

use std::path::{Path, PathBuf};

use crate::dataset::error::DatasetError;
use crate::dataset::metadata::episode::Episode;
use crate::dataset::metadata::info::{Camera, CameraStorage, FormatVersion, Info};
use crate::dataset::metadata::normalizer::Stats;
use crate::dataset::metadata::{episodes, stats, tasks};
use crate::dataset::recover::unfinished::explained;
use crate::dataset::repair::Repair;
use crate::dataset::tables::motion::Motion;
use crate::dataset::tables::spread::Spread;
use crate::dataset::tables::whole_rows::lacks_footer;
use crate::dataset::video_fit::merged_videos;
use crate::dataset::video_fit::short_episodes::{self, LeftOut};

/// A recording, opened and checked. A [`Loader`](crate::dataset::Loader) decodes pixels on demand.
///
/// States and actions are in memory (a few dozen bytes a frame), videos are not.
#[derive(Debug)]
pub struct Dataset {
    root: PathBuf,
    pub(super) info: Info,
    stats: Stats,
    normalisation: Option<Stats>,
    tasks: Vec<String>,
    episodes: Vec<Episode>,
    pub(crate) motion: Motion,
    /// Of states and actions of all rows, also of left-out episodes.
    pub(super) spreads: [Spread; 2],
    repairs: Vec<Repair>,
    left_out: Vec<LeftOut>,
}

impl Dataset {
    /// Opens the LeRobotDataset folder `root`. Corrected faults are logged and listed in [`Dataset::repairs`]. Episodes with fewer pictures
    /// than rows are logged, and only in [`Dataset::left_out`].
    ///
    /// # Errors
    /// [`DatasetError`]: anything missing, unreadable or inconsistent outside the videos' content, with its path.
    pub fn open(root: impl AsRef<Path>) -> Result<Self, DatasetError> {
        let root = root.as_ref().to_path_buf();
        let mut repairs = Vec::new();
        let info = Info::read(&root)?;
        let tasks = tasks::read_tasks(&root, &info)?;
        let mut episodes = episodes::read_episodes(&root, &info, &mut repairs)
            .map_err(|error| explained(&root, &info, error))?;
        let stats = stats::read(&root, &info, &episodes)?;
        let mut motion = Motion::read(&root, &info, &episodes, tasks.len(), &mut repairs)
            .map_err(|error| cut_off(&root, &info, error))?;
        let spreads = motion.spreads();
        merged_videos::repair(&root, &info, &mut episodes, &mut repairs)?;
        let left_out = short_episodes::find(&info, &episodes, &mut repairs);
        short_episodes::remove(&left_out, &mut episodes, &mut motion);
        for repair in &repairs {
            tracing::warn!("{repair}");
        }
        for episode in &left_out {
            tracing::warn!("{episode}");
        }
        if let (true, Some(first)) = (episodes.is_empty(), left_out.first()) {
            return Err(DatasetError::NoWholeEpisode {
                path: root,
                first: first.to_string(),
            });
        }
        Ok(Self {
            root,
            info,
            stats,
            normalisation: None,
            tasks,
            episodes,
            motion,
            spreads,
            repairs,
            left_out,
        })
    }

    /// Frames of all episodes.
    pub fn len(&self) -> usize {
        self.motion.len()
    }

    /// Always `false`: [`Dataset::open`] refuses a folder without frames.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The folder that was opened.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Frames per second.
    pub fn fps(&self) -> u32 {
        self.info.fps
    }

    /// `meta/info.json`: robot type, features.
    pub fn info(&self) -> &Info {
        &self.info
    }

    /// The cameras in the order of the recording and of [`Frame::images`](crate::dataset::Frame::images).
    pub fn cameras(&self) -> &[Camera] {
        &self.info.cameras
    }

    /// The recording's own statistics.
    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    /// What normalises samples: its own statistics, unless [`Dataset::normalise_with`] set others.
    pub fn normalisation(&self) -> &Stats {
        self.normalisation.as_ref().unwrap_or(&self.stats)
    }

    /// Normalises samples with other statistics: a policy's, or those of several recordings.
    ///
    /// # Errors
    /// [`DatasetError::Normalisation`] when dimensions differ.
    pub fn normalise_with(&mut self, stats: Stats) -> Result<(), DatasetError> {
        let dims = |stats: &Stats| (stats.state.dim(), stats.action.dim());
        if dims(&stats) != dims(&self.stats) {
            return Err(DatasetError::Normalisation {
                path: self.root.clone(),
                given: dims(&stats),
                found: dims(&self.stats),
            });
        }
        self.normalisation = Some(stats);
        Ok(())
    }

    /// Task strings by [`Frame::task_index`](crate::dataset::Frame::task_index).
    pub fn tasks(&self) -> &[String] {
        &self.tasks
    }

    /// Episodes in order, without those left out; they tile the frames `0..len()`.
    pub fn episodes(&self) -> &[Episode] {
        &self.episodes
    }

    /// Faults that reading corrected; mostly none.
    pub fn repairs(&self) -> &[Repair] {
        &self.repairs
    }

    /// Episodes with fewer pictures than rows, by camera; mostly none. [`Dataset::episodes`] and the frames lack them; the recording's own
    /// statistics include them.
    pub fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    /// `observation.state` of frame `index`, not normalised; `None` beyond the end.
    pub fn state(&self, index: usize) -> Option<&[f32]> {
        (index < self.len()).then(|| self.motion.state(index))
    }

    /// `action` of frame `index`, not normalised; `None` beyond the end.
    pub fn action(&self, index: usize) -> Option<&[f32]> {
        (index < self.len()).then(|| self.motion.action(index))
    }

    /// Frames per task, in the order of [`Dataset::tasks`].
    pub fn frames_per_task(&self) -> Vec<usize> {
        let mut counts = vec![0; self.tasks.len()];
        for frame in 0..self.len() {
            counts[self.motion.task(frame)] += 1;
        }
        counts
    }
}

/// Adds the remedy to an error about a data file that lost its end.
fn cut_off(root: &Path, info: &Info, error: DatasetError) -> DatasetError {
    let has_depth = !info.depth_maps.is_empty();
    let mut storages = info.cameras.iter().map(|camera| camera.storage);
    let can_be_saved = info.format == FormatVersion::V30
        && !has_depth
        && storages.all(|s| s == CameraStorage::Video);
    match error {
        DatasetError::Parquet { path, cause } if can_be_saved && lacks_footer(&path) => {
            DatasetError::CutOff {
                path,
                cause,
                root: root.into(),
            }
        }
        error => error,
    }
}
