//! Robot recordings: a reader of LeRobotDataset v3.0 folders.
//!
//! ```text
//! meta/info.json                     info      frames per second, features, where the files are
//! meta/stats.json                    stats     mean and standard deviation; normalisation
//! meta/tasks.parquet                 episodes  task strings
//! meta/episodes/*/*.parquet          episodes  which rows and which stretch of video an episode is
//! data/*/*.parquet                   motion    states, actions, timestamps (columns reads the parquet)
//! videos/*/*/*.mp4                   video     one camera's frames: mp4 finds them, av1 decodes, color makes RGB
//! ```
//!
//! [`Dataset::open`] reads everything but the pixels and checks it: what it returns is consistent. [`Dataset::loader`] then gives
//! [`Frame`]s, each what LeRobot's `LeRobotDataset.__getitem__` gives under SmolVLA's `delta_timestamps`
//! (observations now, a chunk of actions from now on). `feature_spec` digests what kind of recording it is, for a commitment.
//!
//! Format: LeRobot 0.4 (`codebase_version` v3.0), <https://huggingface.co/docs/lerobot/lerobot-dataset-v3>.

mod av1;
mod color;
mod columns;
mod episodes;
mod error;
mod feature_spec;
mod info;
mod loader;
mod motion;
mod mp4;
mod stats;
mod video;

use std::path::{Path, PathBuf};

pub use color::{rgb_from_yuv420, Yuv420};
pub use episodes::{Episode, VideoSpan};
pub use error::DatasetError;
pub use feature_spec::FEATURE_SPEC_TAG;
pub use info::{Camera, Info, VectorFeature};
pub use loader::{Frame, Frames, Image, Loader};
pub use mp4::{Mp4Sample, Mp4Track};
pub use stats::{Normalizer, Stats};
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
    tasks: Vec<String>,
    episodes: Vec<Episode>,
    motion: Motion,
}

impl Dataset {
    /// Opens the LeRobotDataset v3.0 folder `root`.
    ///
    /// # Errors
    /// Anything missing, unreadable or inconsistent outside the videos' content, each with its path: see [`DatasetError`].
    /// Among them rows that repeat a frame and timestamps that are not `frame / fps`.
    pub fn open(root: impl AsRef<Path>) -> Result<Self, DatasetError> {
        let root = root.as_ref().to_path_buf();
        if !root.is_dir() {
            return Err(DatasetError::NoFolder { path: root });
        }
        let info = Info::read(&root)?;
        let stats = Stats::read(&root, &info)?;
        let tasks = episodes::read_tasks(&root, &info)?;
        let episodes = episodes::read_episodes(&root, &info)?;
        let motion = Motion::read(&root, &info, &episodes, tasks.len())?;
        Ok(Self {
            root,
            info,
            stats,
            tasks,
            episodes,
            motion,
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

    /// `meta/stats.json`: what states and actions are normalised with.
    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    /// Task strings; [`Frame::task_index`] points into them.
    pub fn tasks(&self) -> &[String] {
        &self.tasks
    }

    /// Episodes in order; they tile the frames `0..len()`.
    pub fn episodes(&self) -> &[Episode] {
        &self.episodes
    }

    /// A loader of frames with action chunks of `chunk` frames: random access, fastest in order.
    ///
    /// # Errors
    /// `chunk` is 0 or above 4096.
    pub fn loader(&self, chunk: usize) -> Result<Loader<'_>, DatasetError> {
        Loader::new(self, chunk)
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
}
