//! An episode and its stretches of video.

use std::ops::Range;
use std::path::PathBuf;

/// One demonstration: consecutive frames, and where each camera filmed them.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    /// Number of the episode among [`Dataset::episodes`](crate::dataset::Dataset::episodes), from 0.
    pub index: usize,
    /// Its number in the recording's files: higher where episodes before it were left out.
    pub recorded: usize,
    /// Its frames in the dataset's numbering; never empty.
    pub frames: Range<usize>,
    /// Its stretch of video per camera, in the order of [`Dataset::cameras`](crate::dataset::Dataset::cameras); `None` where the
    /// camera's pictures are stored one by one.
    pub videos: Vec<Option<VideoSpan>>,
    /// The parquet file that holds its rows, as the metadata says. In v3.0 it is no more than a hint, because rows have their numbers.
    pub(crate) data_file: PathBuf,
}

impl Episode {
    /// Its stretch of a camera's video; `None` where the camera has none.
    pub(crate) fn video(&self, camera: usize) -> Option<&VideoSpan> {
        self.videos.get(camera)?.as_ref()
    }
}

/// Where an episode lies in a camera's video file; in v3.0 several episodes share one.
#[derive(Debug, Clone, PartialEq)]
pub struct VideoSpan {
    /// The mp4 file.
    pub path: PathBuf,
    /// Second of the file at which the episode's first frame is shown.
    pub from_timestamp: f64,
    /// Second of the file at which it ends, where the metadata says so.
    pub to_timestamp: Option<f64>,
}
