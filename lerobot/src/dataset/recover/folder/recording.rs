//! A recording to write, and where its files go.

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

/// LeRobot's names of data files and videos.
pub(crate) const DATA_PATH: &str = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet";
pub(crate) const VIDEO_PATH: &str =
    "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4";
/// Files per folder `chunk-…`.
pub(crate) const CHUNK: u64 = 1000;

pub(crate) struct Recording {
    /// `meta/info.json`; writing sets its totals and paths.
    pub info: JsonInOrder,
    pub fps: u32,
    pub tasks: Vec<String>,
    /// Columns of the rows: all features but videos.
    pub schema: SchemaRef,
    pub episodes: Vec<EpisodeToWrite>,
    /// Each camera that filmed, with its videos in order.
    pub videos: Vec<(Camera, Vec<VideoToWrite>)>,
    /// Where rows have their pictures.
    pub files: DataFiles,
}

pub(crate) struct EpisodeToWrite {
    /// Rows without pictures; writing sets `episode_index` and `index`.
    pub rows: Vec<RecordBatch>,
    /// The same rows, counted over the source's files.
    pub read_from: Range<usize>,
    pub tasks: Vec<usize>,
    /// Per camera that filmed: the number of its video, and the seconds where the episode begins and ends.
    pub stretches: Vec<(usize, f64, f64)>,
    /// Of pictures in rows, by camera.
    pub pictures: BTreeMap<String, Statistics>,
}

pub(crate) enum VideoToWrite {
    Copy(PathBuf),
    /// A file that `write` makes at the given path.
    Make(Box<dyn Fn(&Path) -> Result<(), DatasetError>>),
}

impl Recording {
    pub fn cameras(&self) -> impl Iterator<Item = &str> {
        let filmed = self.videos.iter().map(|(camera, _)| camera.name.as_str());
        let fields = self.schema.fields().iter();
        let stored = fields.filter(|field| matches!(field.data_type(), DataType::Struct(_)));
        filmed.chain(stored.map(|field| field.name().as_str()))
    }
}

impl EpisodeToWrite {
    pub fn len(&self) -> usize {
        self.rows.iter().map(RecordBatch::num_rows).sum()
    }
}

/// The path of file `number` of a kind; makes its folder.
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
