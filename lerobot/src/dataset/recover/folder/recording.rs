//! A recording to be written, and where its files go.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use arrow_array::RecordBatch;
use arrow_schema::{DataType, SchemaRef};

use crate::dataset::metadata::info::Camera;
use crate::dataset::metadata::paths::{fill, RecordingFile};
use crate::dataset::recover::json_in_order::JsonInOrder;
use crate::dataset::recover::statistics::columns::Statistics;
use crate::dataset::recover::stored::DataFiles;
use crate::dataset::DatasetError;

/// LeRobot's names of data files and of videos.
pub(crate) const DATA_PATH: &str = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet";
pub(crate) const VIDEO_PATH: &str =
    "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4";
/// Files in a folder `chunk-…`.
pub(crate) const CHUNK: u64 = 1000;

/// A recording to be written.
pub(crate) struct Recording {
    /// `meta/info.json`; its totals and paths are set on writing.
    pub info: JsonInOrder,
    pub fps: u32,
    pub tasks: Vec<String>,
    /// Columns of the rows: those of all features but the videos.
    pub schema: SchemaRef,
    pub episodes: Vec<EpisodeToWrite>,
    /// Each camera that filmed, and its videos in order.
    pub videos: Vec<(Camera, Vec<VideoToWrite>)>,
    /// Where the rows have their pictures.
    pub files: DataFiles,
}

/// An episode to be written.
pub(crate) struct EpisodeToWrite {
    /// Its rows without pictures; `episode_index` and `index` are set on writing.
    pub rows: Vec<RecordBatch>,
    /// The same rows, counted over all files of the source.
    pub read_from: Range<usize>,
    pub tasks: Vec<usize>,
    /// For each camera that filmed: which of its videos, and the seconds at which the episode begins and ends there.
    pub stretches: Vec<(usize, f64, f64)>,
    /// Of the pictures that its rows hold, by the camera.
    pub pictures: BTreeMap<String, Statistics>,
}

/// A camera's video.
pub(crate) enum VideoToWrite {
    /// A file to copy.
    Copy(PathBuf),
    /// A file that `write` makes at the path that it is given.
    Make(Box<dyn Fn(&Path) -> Result<(), DatasetError>>),
}

impl Recording {
    /// The names of all features that are pictures.
    pub fn cameras(&self) -> impl Iterator<Item = &str> {
        let filmed = self.videos.iter().map(|(camera, _)| camera.name.as_str());
        let fields = self.schema.fields().iter();
        let stored = fields.filter(|field| matches!(field.data_type(), DataType::Struct(_)));
        filmed.chain(stored.map(|field| field.name().as_str()))
    }
}

impl EpisodeToWrite {
    /// How many rows it has.
    pub fn len(&self) -> usize {
        self.rows.iter().map(RecordBatch::num_rows).sum()
    }
}

/// The path of file `number` of a kind; its folder is made.
pub(crate) fn place(
    folder: &Path,
    template: &str,
    camera: &str,
    number: u64,
) -> io::Result<PathBuf> {
    let place = RecordingFile::Shared {
        chunk: number / CHUNK,
        file: number % CHUNK,
    };
    let path = folder.join(fill(template, camera, place).map_err(io::Error::other)?);
    fs::create_dir_all(zk0_files::atomic_file::folder_of(&path))?;
    Ok(path)
}
