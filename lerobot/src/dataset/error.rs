//! What can be wrong with a recording, for the person who repairs it.

use std::path::{Path, PathBuf};

use crate::lfs_pointer;

/// Why a recording could not be read: the file, the fault, the remedy.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The dataset's folder does not exist.
    #[error("{}: no such folder; a LeRobotDataset is a folder with meta/, data/ and videos/", path.display())]
    NoFolder { path: PathBuf },
    /// A file that the metadata names does not exist.
    #[error("{}: missing; the recording is incomplete, copy it again", path.display())]
    MissingFile { path: PathBuf },
    /// A rename map gives two cameras one name.
    #[error("{}: --rename-map calls two cameras {name:?}: give each camera another name", path.display())]
    RenamedAlike { path: PathBuf, name: String },
    /// A rename map has a name that no camera has.
    #[error(
        "{}: --rename-map names {name:?}, and the cameras are {cameras:?}",
        path.display()
    )]
    NoSuchCamera {
        path: PathBuf,
        name: String,
        cameras: Vec<String>,
    },
    /// A folder without a recording.
    #[error("{}: holds no recording; a LeRobotDataset is a folder with meta/, data/ and videos/", path.display())]
    NoRecording { path: PathBuf },
    /// Recording ended before `meta/episodes` was written.
    #[error(
        "{}: the recording ended too early ({sign}); save its whole episodes with: zk0 dataset recover {} --out NEW_FOLDER",
        path.display(), path.display()
    )]
    Unfinished {
        path: PathBuf,
        /// How the files show it.
        sign: String,
    },
    /// A data file of a finished recording lost its end.
    #[error(
        "{}: {cause}; the file has no end: copy it again, or save the episodes before it with: zk0 dataset recover {} --out NEW_FOLDER",
        path.display(), root.display()
    )]
    CutOff {
        path: PathBuf,
        cause: String,
        /// The recording.
        root: PathBuf,
    },
    /// Recording ended before an episode was saved.
    #[error(
        "{}: no episode was finished before the recording ended, so there is nothing to read, and nothing that `zk0 dataset recover` \
         could save: record again",
        path.display()
    )]
    NothingFinished { path: PathBuf },
    /// A file could not be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        path: PathBuf,
        source: std::io::Error,
    },
    /// A file or folder could not be written.
    #[error("{}: cannot be written: {source}", path.display())]
    Write {
        path: PathBuf,
        source: std::io::Error,
    },
    /// A metadata file is not what LeRobot writes.
    #[error("{}: {cause}", path.display())]
    Meta { path: PathBuf, cause: String },
    /// Another version of the format.
    #[error(
        "{}: the format is {found:?}, and only v2.0, v2.1 and v3.0 are read; convert older recordings with LeRobot 0.3 and 0.4: python -m \
         lerobot.datasets.v30.convert_dataset_v21_to_v30",
        path.display()
    )]
    Version { path: PathBuf, found: String },
    /// A parquet file is damaged, or a column is missing or of another type.
    #[error("{}: {cause}", path.display())]
    Parquet { path: PathBuf, cause: String },
    /// A frame is in the table twice, with different values.
    #[error(
        "{}: row {row} holds episode {episode} frame {frame} again (index {index}) with other values; remove the rows that \
         are wrong",
        path.display()
    )]
    RepeatedFrame {
        path: PathBuf,
        row: usize,
        index: i64,
        episode: i64,
        frame: i64,
    },
    /// A timestamp is not frame number / frames per second.
    #[error(
        "{}: episode {episode} frame {frame} has timestamp {timestamp} s where {expected:.6} s is expected (tolerance 0.0001 s)",
        path.display()
    )]
    Timestamp {
        path: PathBuf,
        episode: usize,
        frame: usize,
        timestamp: f32,
        expected: f64,
    },
    /// Fewer rows than the metadata declares.
    #[error("{}: the data ends after {found} frames, meta/info.json declares {declared}", path.display())]
    FewerFrames {
        path: PathBuf,
        found: usize,
        declared: usize,
    },
    /// A video's container or a frame is unusable.
    #[error("{}: {cause}", path.display())]
    Video { path: PathBuf, cause: String },
    /// A stored PNG or JPEG picture is unusable.
    #[error("{}: {cause}", path.display())]
    StoredPicture { path: PathBuf, cause: String },
    /// A frame's picture cannot be read.
    #[error("episode {episode} frame {frame}, camera {camera}: {source}")]
    Picture {
        episode: usize,
        frame: usize,
        camera: String,
        source: Box<DatasetError>,
    },
    /// Two episodes have the same pictures, and nothing tells whose they are.
    #[error(
        "{}: meta/episodes gives episodes {first} and {second} the same pictures of camera {camera}, as merges by LeRobot 0.4.0 to \
         0.4.2 do, and the episodes in order do not fill the camera's files exactly, so this cannot be repaired; LeRobot reads wrong \
         pictures here; merge the recordings again with LeRobot 0.4.3 or later",
        path.display()
    )]
    SharedPictures {
        path: PathBuf,
        camera: String,
        first: usize,
        second: usize,
    },
    /// No episode has a picture for every row.
    #[error("{}: no episode has a picture for every row. {first}", path.display())]
    NoWholeEpisode { path: PathBuf, first: String },
    /// The given statistics have other dimensions than the recording.
    #[error(
        "{}: has {} state and {} action dimensions, the statistics to normalise it with have {} and {}",
        path.display(), found.0, found.1, given.0, given.1
    )]
    Normalisation {
        path: PathBuf,
        given: (usize, usize),
        found: (usize, usize),
    },
    /// Recordings that are used together differ.
    #[error(
        "{}: has {cause} as {} has; recordings that are used together have to agree",
        path.display(), first.display()
    )]
    Different {
        path: PathBuf,
        first: PathBuf,
        cause: String,
    },
    /// The requested frame does not exist.
    #[error("there is no frame {index}: the recording has {len} frames")]
    OutOfRange { index: usize, len: usize },
    /// The requested action chunk has a forbidden length.
    #[error("an action chunk cannot have {chunk} frames; it must have 1 to {max}")]
    Chunk { chunk: usize, max: usize },
}

impl DatasetError {
    /// Tells a missing file from an unreadable one.
    pub(crate) fn io(path: impl Into<PathBuf>, source: std::io::Error) -> Self {
        let path = path.into();
        if source.kind() == std::io::ErrorKind::NotFound {
            Self::MissingFile { path }
        } else {
            Self::Io { path, source }
        }
    }

    pub(crate) fn write(path: impl Into<PathBuf>, source: std::io::Error) -> Self {
        Self::Write {
            path: path.into(),
            source,
        }
    }

    pub(crate) fn meta(path: impl Into<PathBuf>, cause: impl Into<String>) -> Self {
        let path = path.into();
        let cause = cause_at(&path, cause);
        Self::Meta { path, cause }
    }

    pub(crate) fn parquet(path: impl Into<PathBuf>, cause: impl Into<String>) -> Self {
        let path = path.into();
        let cause = cause_at(&path, cause);
        Self::Parquet { path, cause }
    }

    pub(crate) fn video(path: impl Into<PathBuf>, cause: impl Into<String>) -> Self {
        let path = path.into();
        let cause = cause_at(&path, cause);
        Self::Video { path, cause }
    }
}

/// Names a file that Git LFS has not fetched, whatever its reader found.
fn cause_at(path: &Path, cause: impl Into<String>) -> String {
    lfs_pointer::explain(path).unwrap_or_else(|| cause.into())
}
