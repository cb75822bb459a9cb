//! Writes the folder of a recording, v3.0, as LeRobot 0.6.1 reads it.
//!
//! Of the statistics, those of numbers are computed from the rows; `stats` has those of the pictures, where there are any. LeRobot also
//! keeps the statistics of each episode's pictures in `meta/episodes`. They are left out here, and LeRobot loads the folder without
//! them.

use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::builder::{Float64Builder, ListBuilder, StringBuilder};
use arrow_array::{ArrayRef, Float64Array, Int64Array, ListArray, RecordBatch, StringArray};
use arrow_schema::{Field, SchemaRef};
use parquet::arrow::ArrowWriter;
use parquet::basic::Compression;
use parquet::file::properties::WriterProperties;
use serde_json::{json, Map, Value};

use crate::dataset::metadata::paths::{fill, RecordingFile};
use crate::dataset::recover::json_in_order::JsonInOrder;
use crate::dataset::recover::statistics::{numbers, Statistics};
use crate::dataset::DatasetError;

/// LeRobot's names of data files and of videos.
pub(crate) const DATA_PATH: &str = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet";
pub(crate) const VIDEO_PATH: &str =
    "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4";
/// Files in a folder `chunk-…`.
const CHUNK: u64 = 1000;

/// A recording to be written.
pub(crate) struct Recording {
    /// `meta/info.json`; its totals and paths are set on writing.
    pub info: JsonInOrder,
    pub tasks: Vec<String>,
    /// Columns of the rows: those of all features but the videos.
    pub schema: SchemaRef,
    pub episodes: Vec<EpisodeToWrite>,
    /// Each camera's name and videos, in order.
    pub videos: Vec<(String, Vec<VideoToWrite>)>,
    /// Statistics that are not computed from the rows: those of the pictures.
    pub stats: Map<String, Value>,
}

/// An episode to be written.
pub(crate) struct EpisodeToWrite {
    /// Its rows; `episode_index` and `index` are set on writing.
    pub rows: Vec<RecordBatch>,
    pub tasks: Vec<usize>,
    /// For each camera: which of its videos, and the seconds at which the episode begins and ends there.
    pub stretches: Vec<(usize, f64, f64)>,
}

/// A camera's video.
pub(crate) enum VideoToWrite {
    /// A file to copy.
    Copy(PathBuf),
    /// A file that `write` makes at the path that it is given.
    Make(Box<dyn Fn(&Path) -> Result<(), DatasetError>>),
}

impl EpisodeToWrite {
    fn len(&self) -> usize {
        self.rows.iter().map(RecordBatch::num_rows).sum()
    }

    /// The statistics of its numbers, by the name of the feature.
    fn statistics(&self, number: usize, start: usize) -> io::Result<BTreeMap<String, Statistics>> {
        let mut all: BTreeMap<String, (Vec<f64>, usize)> = BTreeMap::new();
        for batch in self.numbered(number, start)? {
            for (field, column) in batch.schema().fields().iter().zip(batch.columns()) {
                if let Some((values, dim)) = numbers(column) {
                    let known = all.entry(field.name().clone()).or_insert((Vec::new(), dim));
                    known.0.extend(values);
                }
            }
        }
        let of = |(name, (values, dim)): (String, (Vec<f64>, usize))| {
            (name, Statistics::of(&values, dim))
        };
        Ok(all.into_iter().map(of).collect())
    }

    /// Its rows as those of episode `number`, the first of which is row `start` of the recording.
    fn numbered(&self, number: usize, mut start: usize) -> io::Result<Vec<RecordBatch>> {
        let mut batches = Vec::with_capacity(self.rows.len());
        for batch in &self.rows {
            let end = start + batch.num_rows();
            let index: ArrayRef = Arc::new(Int64Array::from_iter_values(
                (start..end).map(|row| row as i64),
            ));
            let episode: ArrayRef =
                Arc::new(Int64Array::from(vec![number as i64; batch.num_rows()]));
            let column = |(field, column): (&Arc<Field>, &ArrayRef)| match field.name().as_str() {
                "index" => index.clone(),
                "episode_index" => episode.clone(),
                _ => column.clone(),
            };
            let columns = batch.schema_ref().fields().iter().zip(batch.columns());
            let columns = columns.map(column).collect();
            batches.push(RecordBatch::try_new(batch.schema(), columns).map_err(io::Error::other)?);
            start = end;
        }
        Ok(batches)
    }
}

impl Recording {
    /// Writes everything into `folder`, which is empty. All bytes are on the disk when this returns.
    ///
    /// # Errors
    /// What cannot be read of the recording, or not be written.
    pub fn write(&self, folder: &Path) -> Result<(), DatasetError> {
        self.write_videos(folder)?;
        self.write_tables(folder)
            .map_err(|e| DatasetError::write(folder, e))
    }

    fn write_videos(&self, folder: &Path) -> Result<(), DatasetError> {
        for (camera, videos) in &self.videos {
            for (number, video) in videos.iter().enumerate() {
                let path = place(folder, VIDEO_PATH, camera, number as u64)
                    .map_err(|e| DatasetError::write(folder, e))?;
                let io = |e: io::Error| DatasetError::write(&path, e);
                match video {
                    VideoToWrite::Copy(from) => {
                        let mut from = File::open(from).map_err(|e| DatasetError::io(from, e))?;
                        let mut to = File::create_new(&path).map_err(io)?;
                        io::copy(&mut from, &mut to).map_err(io)?;
                    }
                    VideoToWrite::Make(make) => make(&path)?,
                }
                let written = File::open(&path).and_then(|file| file.sync_all());
                written.map_err(io)?;
            }
        }
        Ok(())
    }

    fn write_tables(&self, folder: &Path) -> io::Result<()> {
        let mut start = 0;
        let mut statistics = Vec::with_capacity(self.episodes.len());
        for (number, episode) in self.episodes.iter().enumerate() {
            statistics.push(episode.statistics(number, start)?);
            start += episode.len();
        }
        self.write_rows(&place(folder, DATA_PATH, "", 0)?)?;
        let episodes = place(
            folder,
            "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "",
            0,
        )?;
        self.write_episodes(&episodes, &statistics)?;
        let meta = folder.join("meta");
        self.write_tasks(&meta.join("tasks.parquet"))?;
        write_json(&meta.join("stats.json"), &self.stats(&statistics))?;
        write_json(&meta.join("info.json"), &self.info(start))?;
        sync_folders(folder)
    }

    fn info(&self, frames: usize) -> JsonInOrder {
        let mut info = self.info.clone();
        let episodes = self.episodes.len();
        for (key, value) in [
            ("total_episodes", episodes.into()),
            ("total_frames", frames.into()),
            ("total_tasks", self.tasks.len().into()),
            ("chunks_size", CHUNK.into()),
            ("data_path", DATA_PATH.into()),
            ("video_path", VIDEO_PATH.into()),
        ] {
            info.set(key, value);
        }
        let all = ("train".into(), format!("0:{episodes}").into());
        info.set("splits", JsonInOrder::Object(vec![all]));
        info
    }

    fn stats(&self, episodes: &[BTreeMap<String, Statistics>]) -> Value {
        let mut stats = self.stats.clone();
        for name in episodes.iter().flat_map(BTreeMap::keys) {
            let each: Vec<&Statistics> = episodes.iter().filter_map(|e| e.get(name)).collect();
            let pooled = Statistics::pooled(&each);
            let mut entry: Map<String, Value> = pooled
                .entries()
                .map(|(name, values)| (name.into(), values.clone().into()))
                .collect();
            entry.insert("count".into(), json!([pooled.count]));
            stats.insert(name.clone(), entry.into());
        }
        stats.into()
    }

    /// One row group for each episode, as LeRobot writes them.
    fn write_rows(&self, path: &Path) -> io::Result<()> {
        let mut writer = ArrowWriter::try_new(
            File::create_new(path)?,
            self.schema.clone(),
            Some(properties()),
        )
        .map_err(io::Error::other)?;
        let mut start = 0;
        for (number, episode) in self.episodes.iter().enumerate() {
            for batch in episode.numbered(number, start)? {
                writer.write(&batch).map_err(io::Error::other)?;
            }
            writer.flush().map_err(io::Error::other)?;
            start += episode.len();
        }
        writer.into_inner().map_err(io::Error::other)?.sync_all()
    }

    fn write_tasks(&self, path: &Path) -> io::Result<()> {
        let indices = Int64Array::from_iter_values(0..self.tasks.len() as i64);
        let columns: [(&str, ArrayRef); 2] = [
            ("task_index", Arc::new(indices)),
            ("task", Arc::new(StringArray::from(self.tasks.clone()))),
        ];
        // LeRobot finds a task by the index of the table, and pandas reads here which column that is.
        let column = |name: &str, pandas: &str, numpy: &str| json!({"name": name, "field_name": name, "pandas_type": pandas, "numpy_type": numpy, "metadata": null});
        let pandas = json!({
            "index_columns": ["task"],
            "column_indexes": [],
            "columns": [
                column("task_index", "int64", "int64"),
                column("task", "unicode", "object"),
            ],
        });
        let pandas = HashMap::from([("pandas".into(), pandas.to_string())]);
        write_table(path, columns, pandas)
    }

    fn write_episodes(
        &self,
        path: &Path,
        statistics: &[BTreeMap<String, Statistics>],
    ) -> io::Result<()> {
        let ints = |of: &dyn Fn(usize, &EpisodeToWrite) -> usize| -> ArrayRef {
            let values = self
                .episodes
                .iter()
                .enumerate()
                .map(|(i, e)| of(i, e) as i64);
            Arc::new(Int64Array::from_iter_values(values))
        };
        let mut starts = vec![0];
        starts.extend(self.episodes.iter().scan(0, |end, episode| {
            *end += episode.len();
            Some(*end)
        }));
        let mut columns: Vec<(String, ArrayRef)> = vec![
            ("episode_index".into(), ints(&|i, _| i)),
            ("tasks".into(), Arc::new(self.tasks_of_episodes())),
            ("length".into(), ints(&|_, e| e.len())),
            ("data/chunk_index".into(), ints(&|_, _| 0)),
            ("data/file_index".into(), ints(&|_, _| 0)),
            ("dataset_from_index".into(), ints(&|i, _| starts[i])),
            ("dataset_to_index".into(), ints(&|i, _| starts[i + 1])),
        ];
        for (at, (camera, _)) in self.videos.iter().enumerate() {
            let seconds = |of: fn(&(usize, f64, f64)) -> f64| -> ArrayRef {
                let values = self.episodes.iter().map(|e| of(&e.stretches[at]));
                Arc::new(Float64Array::from_iter_values(values))
            };
            let chunk = CHUNK as usize;
            for (name, column) in [
                ("chunk_index", ints(&|_, e| e.stretches[at].0 / chunk)),
                ("file_index", ints(&|_, e| e.stretches[at].0 % chunk)),
                ("from_timestamp", seconds(|stretch| stretch.1)),
                ("to_timestamp", seconds(|stretch| stretch.2)),
            ] {
                columns.push((format!("videos/{camera}/{name}"), column));
            }
        }
        columns.extend(columns_of(statistics));
        for name in ["meta/episodes/chunk_index", "meta/episodes/file_index"] {
            columns.push((name.into(), ints(&|_, _| 0)));
        }
        write_table(path, columns, HashMap::new())
    }

    fn tasks_of_episodes(&self) -> ListArray {
        let field = Field::new("element", arrow_schema::DataType::Utf8, true);
        let mut lists = ListBuilder::new(StringBuilder::new()).with_field(field);
        for episode in &self.episodes {
            for &task in &episode.tasks {
                lists.values().append_value(&self.tasks[task]);
            }
            lists.append(true);
        }
        lists.finish()
    }
}

/// Columns `stats/FEATURE/NAME` of the episodes.
fn columns_of(statistics: &[BTreeMap<String, Statistics>]) -> Vec<(String, ArrayRef)> {
    let mut columns: Vec<(String, ArrayRef)> = Vec::new();
    for feature in statistics.first().into_iter().flat_map(BTreeMap::keys) {
        let mut lists: BTreeMap<&str, ListBuilder<Float64Builder>> = BTreeMap::new();
        let mut names = Vec::new();
        let mut counts = Vec::new();
        for episode in statistics.iter().filter_map(|episode| episode.get(feature)) {
            for (name, values) in episode.entries() {
                let list = lists.entry(name).or_insert_with(|| {
                    names.push(name);
                    let field = Field::new("element", arrow_schema::DataType::Float64, true);
                    ListBuilder::new(Float64Builder::new()).with_field(field)
                });
                list.values().append_slice(values);
                list.append(true);
            }
            counts.push(Some(vec![Some(episode.count as i64)]));
        }
        for name in names {
            if let Some(list) = lists.get_mut(name) {
                columns.push((format!("stats/{feature}/{name}"), Arc::new(list.finish())));
            }
        }
        let counts = ListArray::from_iter_primitive::<arrow_array::types::Int64Type, _, _>(counts);
        columns.push((format!("stats/{feature}/count"), Arc::new(counts)));
    }
    columns
}

fn properties() -> WriterProperties {
    WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .build()
}

fn write_table<N: AsRef<str>>(
    path: &Path,
    columns: impl IntoIterator<Item = (N, ArrayRef)>,
    metadata: HashMap<String, String>,
) -> io::Result<()> {
    let table = RecordBatch::try_from_iter(columns).map_err(io::Error::other)?;
    // pyarrow takes the metadata of the schema that arrow writes, and no other.
    let schema = Arc::new(table.schema().as_ref().clone().with_metadata(metadata));
    let table = table
        .with_schema(schema.clone())
        .map_err(io::Error::other)?;
    let mut writer = ArrowWriter::try_new(File::create_new(path)?, schema, Some(properties()))
        .map_err(io::Error::other)?;
    writer.write(&table).map_err(io::Error::other)?;
    writer.into_inner().map_err(io::Error::other)?.sync_all()
}

fn write_json(path: &Path, value: &impl serde::Serialize) -> io::Result<()> {
    let mut file = File::create_new(path)?;
    file.write_all(&serde_json::to_vec_pretty(value)?)?;
    file.sync_all()
}

/// The path of file `number` of a kind; its folder is made.
fn place(folder: &Path, template: &str, camera: &str, number: u64) -> io::Result<PathBuf> {
    let place = RecordingFile::Shared {
        chunk: number / CHUNK,
        file: number % CHUNK,
    };
    let path = folder.join(fill(template, camera, place).map_err(io::Error::other)?);
    fs::create_dir_all(zk0_files::atomic_file::folder_of(&path))?;
    Ok(path)
}

/// Waits until the names in a folder and in those below it are on the disk.
fn sync_folders(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            sync_folders(&entry.path())?;
        }
    }
    zk0_files::atomic_file::sync_folder(folder)
}
