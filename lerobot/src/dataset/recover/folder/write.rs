//! Writes the folder.

use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;

use arrow_array::{ArrayRef, Int64Array, StringArray};
use serde_json::{json, Map, Value};

use crate::dataset::recover::folder::episode_table::{write_episodes, WrittenEpisode};
use crate::dataset::recover::folder::filmed::write_videos;
use crate::dataset::recover::folder::recording::{
    place, EpisodeToWrite, Recording, CHUNK, DATA_PATH, VIDEO_PATH,
};
use crate::dataset::recover::folder::rows::write_rows;
use crate::dataset::recover::folder::table::write_table;
use crate::dataset::recover::json_in_order::JsonInOrder;
use crate::dataset::recover::statistics::columns::Statistics;
use crate::dataset::DatasetError;

/// Writes everything into the empty `folder` and syncs it to disk. Returns notes on what is missing.
pub(crate) fn write(recording: &Recording, folder: &Path) -> Result<Vec<String>, DatasetError> {
    let filmed = write_videos(recording, folder)?;
    let rows = write_rows(recording, folder)?;
    let pictures = filmed.statistics.into_iter().zip(&recording.episodes);
    let written: Vec<WrittenEpisode> = rows
        .into_iter()
        .zip(pictures)
        .map(|(rows, (filmed, episode))| {
            let mut statistics = rows.statistics;
            statistics.extend(filmed);
            statistics.extend(episode.pictures.clone());
            WrittenEpisode {
                file: rows.file,
                statistics,
            }
        })
        .collect();
    write_metadata(recording, folder, &written).map_err(|e| DatasetError::write(folder, e))?;
    Ok(filmed.notes)
}

fn write_metadata(
    recording: &Recording,
    folder: &Path,
    written: &[WrittenEpisode],
) -> io::Result<()> {
    let episodes = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet";
    write_episodes(recording, &place(folder, episodes, "", 0)?, written)?;
    let meta = folder.join("meta");
    write_tasks(&meta.join("tasks.parquet"), &recording.tasks)?;
    write_json(&meta.join("stats.json"), &stats(recording, written))?;
    write_json(&meta.join("info.json"), &info(recording))?;
    sync_folders(folder)
}

fn info(recording: &Recording) -> JsonInOrder {
    let mut info = recording.info.clone();
    let episodes = recording.episodes.len();
    let frames: usize = recording.episodes.iter().map(EpisodeToWrite::len).sum();
    let video_path = match recording.videos[..] {
        [] => Value::Null,
        _ => VIDEO_PATH.into(),
    };
    for (key, value) in [
        ("total_episodes", episodes.into()),
        ("total_frames", frames.into()),
        ("total_tasks", recording.tasks.len().into()),
        ("chunks_size", CHUNK.into()),
        ("data_path", DATA_PATH.into()),
        ("video_path", video_path.into()),
    ] {
        info.set(key, value);
    }
    let all = ("train".into(), format!("0:{episodes}").into());
    info.set("splits", JsonInOrder::Object(vec![all]));
    info
}

/// `meta/stats.json`: the statistics of all episodes together.
fn stats(recording: &Recording, written: &[WrittenEpisode]) -> Value {
    let mut stats = Map::new();
    for name in written.iter().flat_map(|e| e.statistics.keys()) {
        if stats.contains_key(name) {
            continue;
        }
        let each = written.iter().filter_map(|e| e.statistics.get(name));
        let pooled = Statistics::pooled(&each.collect::<Vec<_>>());
        let is_camera = recording.cameras().any(|camera| camera == name);
        let mut entry: BTreeMap<&str, Value> = pooled
            .entries()
            .map(|(name, values)| match is_camera {
                // One number per colour has the shape `(3, 1, 1)`.
                true => (name, values.iter().map(|value| json!([[value]])).collect()),
                false => (name, values.clone().into()),
            })
            .collect();
        entry.insert("count", json!([pooled.count]));
        stats.insert(name.clone(), json!(entry));
    }
    stats.into()
}

fn write_tasks(path: &Path, tasks: &[String]) -> io::Result<()> {
    let indices = Int64Array::from_iter_values(0..tasks.len() as i64);
    let columns: [(&str, ArrayRef); 2] = [
        ("task_index", Arc::new(indices)),
        ("task", Arc::new(StringArray::from(tasks.to_vec()))),
    ];
    // LeRobot finds a task by the table's index; pandas reads here which column that is.
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

fn write_json(path: &Path, value: &impl serde::Serialize) -> io::Result<()> {
    let mut file = File::create_new(path)?;
    file.write_all(&serde_json::to_vec_pretty(value)?)?;
    file.sync_all()
}

/// Syncs the names in a folder and below to disk.
fn sync_folders(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            sync_folders(&entry.path())?;
        }
    }
    zk0_files::atomic_file::sync_folder(folder)
}
