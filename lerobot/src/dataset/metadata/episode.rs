//! An episode and its stretches of video.

use std::ops::Range;
use std::path::PathBuf;

/// One demonstration: consecutive frames, and where each camera filmed them.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    /// Number among [`Dataset::episodes`](crate::dataset::Dataset::episodes), from 0.
    pub index: usize,
    /// Its number in the files: higher where earlier episodes were left out.
    pub recorded: usize,
    /// Its frames in the dataset; never empty.
    pub frames: Range<usize>,
    /// Its stretch of video per camera, in the order of [`Dataset::cameras`](crate::dataset::Dataset::cameras); `None` for stored pictures.
    pub videos: Vec<Option<VideoSpan>>,
    /// Its parquet file by the metadata. In v3.0 only a hint, because rows have numbers.
    pub(crate) data_file: PathBuf,
}

impl Episode {
    pub(crate) fn video(&self, camera: usize) -> Option<&VideoSpan> {
        self.videos.get(camera)?.as_ref()
    }
}

/// An episode's place in a camera's video file; in v3.0 several share one.
#[derive(Debug, Clone, PartialEq)]
pub struct VideoSpan {
    /// The mp4 file.
    pub path: PathBuf,
    /// Second of the file that shows the first frame.
    pub from_timestamp: f64,
    /// Second of the file at which it ends, where known.
    pub to_timestamp: Option<f64>,
}
