//! Robot recordings: a reader of LeRobotDataset folders, v2.0, v2.1 and v3.0.
//!
//! ```text
//! meta/info.json                     info      frames per second, features, where the files are (paths)
//! meta/stats.json                    stats     mean and standard deviation; normalisation
//! meta/tasks.parquet                 episodes  task strings
//! meta/episodes/*/*.parquet          episodes  which rows and which stretch of video an episode is
//! data/*/*.parquet                   motion    states, actions, timestamps (columns reads the parquet)
//! videos/*/*/*.mp4                   video     one camera's frames: mp4 finds them, av1 or h264 decodes, color makes RGB
//! ```
//!
//! In v2.x `meta` holds `tasks.jsonl` and `episodes.jsonl` (episodes_v2), in v2.1 `episodes_stats.jsonl` (episode_stats), and
//! every episode has a parquet file and videos of its own.
//!
//! [`Dataset::open`] reads everything but the pixels and checks it: what it returns is consistent, and what had to be put right
//! for that is in [`Dataset::repairs`]. [`Dataset::loader`] then gives [`Frame`]s, each what LeRobot's
//! `LeRobotDataset.__getitem__` gives under SmolVLA's `delta_timestamps` (observations now, a chunk of actions from now on), or
//! under any others ([`DeltaTimestamps`], [`Dataset::loader_with`]). `feature_spec` digests what kind of recording it is, for a
//! commitment.
//!
//! Format: LeRobot 0.4 (`codebase_version` v3.0), <https://huggingface.co/docs/lerobot/lerobot-dataset-v3>, and LeRobot 0.3 (v2.1).

mod av1;
mod color;
mod columns;
mod delta_timestamps;
mod episode_digest;
mod episode_stats;
mod episodes;
mod episodes_v2;
mod error;
mod feature_spec;
mod h264;
mod info;
mod json;
mod loader;
mod motion;
mod mp4;
mod parquet_pages;
mod paths;
mod repair;
mod stats;
mod validate;
mod video;

use std::path::{Path, PathBuf};

pub use color::{rgb_from_yuv420, Yuv420};
pub use delta_timestamps::{DeltaTimestamps, Window};
pub use episodes::{Episode, VideoSpan};
pub use error::DatasetError;
pub use feature_spec::FEATURE_SPEC_TAG;
pub use info::{Camera, Format, Info, VectorFeature};
pub use loader::{Frame, Frames, Image, Loader};
pub use mp4::{AvcConfig, Mp4Codec, Mp4Sample, Mp4Track};
pub use repair::Repair;
pub use stats::{Normalizer, Stats};
pub use validate::PictureFault;
pub use video::VideoReader;

use motion::Motion;

/// A recording, opened and checked; pixels are decoded on demand by a [`Loader`].
///
/// States and actions are held in memory (a few dozen bytes a frame), videos are not.
#[derive(Debug)]
pub struct Dataset {
    root: PathBuf,
    info: Info,
    stats: Stats,
    normalisation: Option<Stats>,
    tasks: Vec<String>,
    episodes: Vec<Episode>,
    motion: Motion,
    repairs: Vec<Repair>,
}

impl Dataset {
    /// Opens the LeRobotDataset folder `root`. What is put right on reading is warned of and kept in [`Dataset::repairs`].
    ///
    /// # Errors
    /// Anything missing, unreadable or inconsistent outside the videos' content, each with its path: see [`DatasetError`].
    /// Among them rows that repeat a frame with other values, and timestamps that are not `frame / fps`.
    pub fn open(root: impl AsRef<Path>) -> Result<Self, DatasetError> {
        let root = root.as_ref().to_path_buf();
        if !root.is_dir() {
            return Err(DatasetError::NoFolder { path: root });
        }
        let mut repairs = Vec::new();
        let info = Info::read(&root)?;
        let stats = Stats::read(&root, &info)?;
        let tasks = episodes::read_tasks(&root, &info)?;
        let episodes = episodes::read_episodes(&root, &info, &mut repairs)?;
        let motion = Motion::read(&root, &info, &episodes, tasks.len(), &mut repairs)?;
        for repair in &repairs {
            tracing::warn!("{repair}");
        }
        Ok(Self {
            root,
            info,
            stats,
            normalisation: None,
            tasks,
            episodes,
            motion,
            repairs,
        })
    }

    /// Number of frames in all episodes together.
    pub fn len(&self) -> usize {
        self.motion.len()
    }

    /// Whether there are no frames; [`Dataset::open`] refuses such a folder, so this is `false`.
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

    /// The cameras in the recording's order, which is the order of [`Frame::images`].
    pub fn cameras(&self) -> &[Camera] {
        &self.info.cameras
    }

    /// The recording's own statistics.
    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    /// What samples of it are normalised with: its own statistics, unless [`Dataset::normalise_with`] has given others.
    pub fn normalisation(&self) -> &Stats {
        self.normalisation.as_ref().unwrap_or(&self.stats)
    }

    /// Has samples of it normalised with other statistics than its own: a policy's, or those of several recordings together.
    ///
    /// # Errors
    /// [`DatasetError::Normalisation`] when they are of other dimensions than its states and actions.
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

    /// Task strings; [`Frame::task_index`] points into them.
    pub fn tasks(&self) -> &[String] {
        &self.tasks
    }

    /// Episodes in order; they tile the frames `0..len()`.
    pub fn episodes(&self) -> &[Episode] {
        &self.episodes
    }

    /// Faults of the files that were put right on reading; mostly none.
    pub fn repairs(&self) -> &[Repair] {
        &self.repairs
    }

    /// A loader of frames with action chunks of `chunk` frames: random access, fastest in order.
    ///
    /// # Errors
    /// `chunk` is 0 or above 4096.
    pub fn loader(&self, chunk: usize) -> Result<Loader<'_>, DatasetError> {
        Ok(Loader::new(self, Window::chunk(&self.info, chunk)?))
    }

    /// A loader of frames with other frames around them, as LeRobot's `delta_timestamps` ask for it.
    ///
    /// # Errors
    /// As [`DeltaTimestamps::window`].
    pub fn loader_with(&self, deltas: &DeltaTimestamps) -> Result<Loader<'_>, DatasetError> {
        Ok(Loader::new(self, deltas.window(&self.info)?))
    }

    /// All frames in order, every video decoded once; stops after the first error.
    ///
    /// # Errors
    /// As [`Dataset::loader`].
    pub fn frames(&self, chunk: usize) -> Result<Frames<'_>, DatasetError> {
        Ok(Frames::new(self.loader(chunk)?))
    }

    /// One frame; a [`Loader`] is faster for more than one.
    ///
    /// # Errors
    /// As [`Loader::frame`].
    pub fn frame(&self, index: usize, chunk: usize) -> Result<Frame, DatasetError> {
        self.loader(chunk)?.frame(index)
    }

    /// `observation.state` of frame `index`, not normalised; `None` if there is no such frame.
    pub fn state(&self, index: usize) -> Option<&[f32]> {
        (index < self.len()).then(|| self.motion.state(index))
    }

    /// `action` of frame `index`, not normalised; `None` if there is no such frame.
    pub fn action(&self, index: usize) -> Option<&[f32]> {
        (index < self.len()).then(|| self.motion.action(index))
    }

    /// Frames of every task, in the order of [`Dataset::tasks`].
    pub fn frames_per_task(&self) -> Vec<usize> {
        let mut counts = vec![0; self.tasks.len()];
        for frame in 0..self.len() {
            counts[self.motion.task(frame)] += 1;
        }
        counts
    }
}
