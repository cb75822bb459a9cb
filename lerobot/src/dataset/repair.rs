//! Faults of a recording that can be read in one way only. The reader corrects and reports them.

use std::fmt;
use std::path::PathBuf;

/// A fault corrected in memory; files are unchanged.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Repair {
    /// A data file repeats rows, all copies alike (LeRobot issue 1875); the first copies were read.
    RepeatedRows {
        /// The parquet file.
        path: PathBuf,
        /// Rows left out.
        rows: usize,
        /// Row of the file, from 0, of the first repetition.
        first: usize,
    },
    /// The metadata describes an episode twice or more, always alike.
    RepeatedEpisodes {
        /// The metadata file.
        path: PathBuf,
        /// Descriptions left out.
        rows: usize,
    },
    /// A merge by LeRobot 0.4.0 to 0.4.2 gave episodes the wrong video file or times; they fill the files exactly.
    MergedVideos {
        /// The camera.
        camera: String,
        /// Episodes with a wrong place.
        episodes: usize,
    },
    /// A camera has more pictures than rows of some episodes; pictures after the last row are not read.
    SurplusPictures {
        /// The camera.
        camera: String,
        /// Number of such episodes.
        episodes: usize,
        /// The first of them, as files number it.
        first: usize,
        /// Its pictures.
        pictures: usize,
        /// Its rows.
        rows: usize,
    },
}

impl fmt::Display for Repair {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::RepeatedRows { path, rows, first } => write!(
                f,
                "{}: {rows} rows repeat frames that are there already (the first is row {first}); the copies are alike and \
                 were left out",
                path.display()
            ),
            Self::RepeatedEpisodes { path, rows } => write!(
                f,
                "{}: {rows} rows describe episodes that are there already; the copies are alike and were left out",
                path.display()
            ),
            Self::MergedVideos { camera, episodes } => write!(
                f,
                "camera {camera}: meta/episodes gives the wrong video file or time for {episodes} episodes, as merges by LeRobot 0.4.0 \
                 to 0.4.2 do; in order, the episodes fill the files exactly, so they are read in order"
            ),
            Self::SurplusPictures {
                camera,
                episodes,
                first,
                pictures,
                rows,
            } => write!(
                f,
                "camera {camera}: more pictures than rows in {episodes} episodes (the first is episode {first}, {pictures} pictures for \
                 {rows} rows); those after the last row are not used"
            ),
        }
    }
}
