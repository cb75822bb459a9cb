//! The pictures that rows hold or name (`use_videos=False`). They are read from their files one by one.

use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};

use parquet::arrow::arrow_reader::ArrowReaderMetadata;

use crate::dataset::metadata::info::Camera;
use crate::dataset::picture::decode::decode;
use crate::dataset::recover::rows::EpisodeRows;
use crate::dataset::recover::statistics::columns::Statistics;
use crate::dataset::recover::statistics::levels::Levels;
use crate::dataset::recover::statistics::sampling::sampled_frames;
use crate::dataset::tables::pictures::{PictureColumn, StoredPicture};
use crate::dataset::DatasetError;

pub(crate) struct DataFiles {
    root: PathBuf,
    files: Vec<UnfinishedFile>,
}

struct UnfinishedFile {
    path: PathBuf,
    metadata: ArrowReaderMetadata,
    /// Its rows, counted over all files.
    rows: Range<usize>,
}

impl DataFiles {
    /// Of the recording in `root`, no file yet.
    pub fn new(root: &Path) -> Self {
        Self {
            root: root.into(),
            files: Vec::new(),
        }
    }

    pub fn add(&mut self, path: &Path, metadata: ArrowReaderMetadata, rows: usize) {
        let start = self.files.last().map_or(0, |file| file.rows.end);
        self.files.push(UnfinishedFile {
            path: path.into(),
            metadata,
            rows: start..start + rows,
        });
    }

    pub fn pictures(&self, camera: &str) -> StoredPictures<'_> {
        StoredPictures {
            files: self,
            camera: camera.into(),
            open: None,
        }
    }
}

/// One data file is open, with at most one page in memory.
pub(crate) struct StoredPictures<'a> {
    files: &'a DataFiles,
    camera: String,
    open: Option<(usize, PictureColumn)>,
}

impl StoredPictures<'_> {
    /// The picture of a row, counted over all files.
    pub fn stored(&mut self, row: usize) -> Result<StoredPicture, DatasetError> {
        let DataFiles { root, files } = self.files;
        let at = files.partition_point(|file| file.rows.end <= row);
        let Some(file) = files.get(at) else {
            return Err(DatasetError::meta(root, format!("has no row {row}")));
        };
        let mut column = match self.open.take() {
            Some((open, column)) if open == at => column,
            _ => {
                let opened = File::open(&file.path).map_err(|e| DatasetError::io(&file.path, e))?;
                let metadata = file.metadata.clone();
                PictureColumn::of(root, &file.path, &self.camera, opened, metadata)?
            }
        };
        let stored = column.stored(row - file.rows.start);
        self.open = Some((at, column));
        stored
    }
}

/// Statistics of a camera's pictures per episode, or why it cannot be saved. Decodes every picture: a disk that lost power leaves cut ones.
pub(crate) fn statistics(
    files: &DataFiles,
    camera: &Camera,
    episodes: &[EpisodeRows],
) -> Vec<Result<Statistics, String>> {
    let mut pictures = files.pictures(&camera.feature);
    let of = |episode: &EpisodeRows| {
        if let Some(fault) = &episode.fault {
            return Err(fault.clone());
        }
        let mut sampled = sampled_frames(episode.rows.len()).into_iter().peekable();
        let mut levels = Levels::new();
        for (frame, row) in episode.rows.clone().enumerate() {
            let fault = |cause: &dyn std::fmt::Display| {
                format!("frame {frame}, camera {}: {cause}", camera.name)
            };
            let stored = pictures.stored(row).map_err(|error| fault(&error))?;
            let rgb = decode(&stored.bytes, camera.height, camera.width)
                .map_err(|cause| fault(&format_args!("{}: {cause}", stored.file.display())))?;
            if sampled.next_if_eq(&frame).is_some() {
                levels.add(&rgb, camera.height, camera.width);
            }
        }
        Ok(levels.statistics())
    };
    episodes.iter().map(of).collect()
}
