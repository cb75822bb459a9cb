//! Makes recordings: LeRobotDataset folders (v3.0) of any length, with a fixture's pictures and motion from a seed.

mod mp4;

use arrow_array::builder::{FixedSizeListBuilder, Float32Builder};
use arrow_array::{ArrayRef, Float32Array, Float64Array, Int64Array, RecordBatch};
use parquet::arrow::ArrowWriter;
use serde_json::Value;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const FIXTURE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../tests/fixtures/datasets/so100_pickplace"
);
const CAMERAS: [&str; 2] = ["observation.images.top", "observation.images.wrist"];
const FPS: f32 = 30.0;
const DIM: usize = 6;

/// An episode to make.
#[derive(Clone, Copy, Debug)]
pub struct MadeEpisode {
    /// Equal seeds and numbers of frames give equal episodes.
    pub seed: u64,
    /// Number of frames.
    pub frames: usize,
    /// Whether nothing moves.
    pub still: bool,
}

/// Makes a recording in the new `folder`, all or no episodes still.
pub fn make(folder: &Path, episodes: &[MadeEpisode]) {
    let still = episodes[0].still;
    assert!(episodes.iter().all(|episode| episode.still == still));
    let fixture = Path::new(FIXTURE);
    let longest = episodes.iter().map(|episode| episode.frames).max();
    for camera in CAMERAS {
        let video = Path::new("videos")
            .join(camera)
            .join("chunk-000/file-000.mp4");
        let made = mp4::made(&fixture.join(&video), longest.unwrap(), still);
        write(&folder.join(video), &made);
    }
    for file in ["meta/stats.json", "meta/tasks.parquet"] {
        write(&folder.join(file), &fs::read(fixture.join(file)).unwrap());
    }
    let info = fs::read(fixture.join("meta/info.json")).unwrap();
    let mut info: Value = serde_json::from_slice(&info).unwrap();
    let frames: usize = episodes.iter().map(|episode| episode.frames).sum();
    info["total_episodes"] = episodes.len().into();
    info["total_frames"] = frames.into();
    write(
        &folder.join("meta/info.json"),
        &serde_json::to_vec(&info).unwrap(),
    );
    write_table(
        &folder.join("meta/episodes/chunk-000/file-000.parquet"),
        &places(episodes),
    );
    write_table(
        &folder.join("data/chunk-000/file-000.parquet"),
        &rows(episodes),
    );
}

fn places(episodes: &[MadeEpisode]) -> RecordBatch {
    let mut from = 0;
    let (mut starts, mut ends) = (Vec::new(), Vec::new());
    for episode in episodes {
        starts.push(from);
        from += episode.frames as i64;
        ends.push(from);
    }
    let count = episodes.len();
    let ints = |values: Vec<i64>| -> ArrayRef { Arc::new(Int64Array::from(values)) };
    let lengths = episodes.iter().map(|episode| episode.frames as i64);
    let mut columns = vec![
        (
            "episode_index".to_owned(),
            ints((0..count as i64).collect()),
        ),
        ("length".into(), ints(lengths.collect())),
        ("dataset_from_index".into(), ints(starts)),
        ("dataset_to_index".into(), ints(ends)),
        ("data/chunk_index".into(), ints(vec![0; count])),
        ("data/file_index".into(), ints(vec![0; count])),
    ];
    for camera in CAMERAS {
        // All show the same pictures.
        let begin: ArrayRef = Arc::new(Float64Array::from(vec![0.0; count]));
        columns.push((format!("videos/{camera}/chunk_index"), ints(vec![0; count])));
        columns.push((format!("videos/{camera}/file_index"), ints(vec![0; count])));
        columns.push((format!("videos/{camera}/from_timestamp"), begin));
    }
    RecordBatch::try_from_iter(columns).unwrap()
}

fn rows(episodes: &[MadeEpisode]) -> RecordBatch {
    let list = || FixedSizeListBuilder::new(Float32Builder::new(), DIM as i32);
    let (mut states, mut actions) = (list(), list());
    let swings = swings();
    let (mut times, mut frames, mut numbers) = (Vec::new(), Vec::new(), Vec::new());
    for (number, episode) in episodes.iter().enumerate() {
        for frame in 0..episode.frames {
            for (list, ahead) in [(&mut states, 0), (&mut actions, 1)] {
                list.values()
                    .append_slice(&position(&swings, episode, frame + ahead));
                list.append(true);
            }
            times.push(frame as f32 / FPS);
            frames.push(frame as i64);
            numbers.push(number as i64);
        }
    }
    let count = numbers.len() as i64;
    let column = |values: Vec<i64>| -> ArrayRef { Arc::new(Int64Array::from(values)) };
    let columns: Vec<(&str, ArrayRef)> = vec![
        ("action", Arc::new(actions.finish())),
        ("observation.state", Arc::new(states.finish())),
        ("timestamp", Arc::new(Float32Array::from(times))),
        ("frame_index", column(frames)),
        ("episode_index", column(numbers)),
        ("index", column((0..count).collect())),
        ("task_index", column(vec![0; count as usize])),
    ];
    RecordBatch::try_from_iter(columns).unwrap()
}

fn swings() -> Vec<(f32, f32)> {
    let stats = fs::read(Path::new(FIXTURE).join("meta/stats.json")).unwrap();
    let stats: Value = serde_json::from_slice(&stats).unwrap();
    let number = |name: &str, joint: usize| {
        let value = &stats["observation.state"][name][joint];
        value.as_f64().unwrap() as f32
    };
    (0..DIM)
        .map(|joint| (number("mean", joint), number("std", joint)))
        .collect()
}

fn position(swings: &[(f32, f32)], episode: &MadeEpisode, frame: usize) -> [f32; DIM] {
    let time = if episode.still {
        0.0
    } else {
        frame as f32 / FPS
    };
    std::array::from_fn(|joint| {
        let pace = 0.5 + 0.1 * joint as f32;
        let phase = (episode.seed as f32).mul_add(0.7, joint as f32);
        let (mean, deviation) = swings[joint];
        mean + deviation * (pace * time + phase).sin()
    })
}

fn write_table(path: &PathBuf, table: &RecordBatch) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let file = File::create(path).unwrap();
    let mut writer = ArrowWriter::try_new(file, table.schema(), None).unwrap();
    writer.write(table).unwrap();
    writer.close().unwrap();
}

fn write(path: &Path, bytes: &[u8]) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}
