//! `meta/episodes`: where each episode is, and its statistics.

use std::collections::{BTreeMap, HashMap};
use std::io;
use std::path::Path;
use std::sync::Arc;

use arrow_array::builder::{ListBuilder, StringBuilder};
use arrow_array::{ArrayRef, FixedSizeListArray, Float64Array, Int64Array, ListArray};
use arrow_schema::{DataType, Field};

use crate::dataset::recover::folder::recording::{EpisodeToWrite, Recording, CHUNK};
use crate::dataset::recover::folder::table::write_table;
use crate::dataset::recover::statistics::columns::Statistics;

pub(super) struct WrittenEpisode {
    /// Its data file.
    pub file: u64,
    /// By feature.
    pub statistics: BTreeMap<String, Statistics>,
}

/// `written` has an entry per episode.
pub(super) fn write_episodes(
    recording: &Recording,
    path: &Path,
    written: &[WrittenEpisode],
) -> io::Result<()> {
    let ints = |of: &dyn Fn(usize, &EpisodeToWrite) -> usize| -> ArrayRef {
        let episodes = recording.episodes.iter().enumerate();
        Arc::new(Int64Array::from_iter_values(
            episodes.map(|(i, e)| of(i, e) as i64),
        ))
    };
    let mut starts = vec![0];
    starts.extend(recording.episodes.iter().scan(0, |end, episode| {
        *end += episode.len();
        Some(*end)
    }));
    let chunk = CHUNK as usize;
    let file = |i: usize| written[i].file as usize;
    let mut columns: Vec<(String, ArrayRef)> = vec![
        ("episode_index".into(), ints(&|i, _| i)),
        ("tasks".into(), Arc::new(tasks(recording))),
        ("length".into(), ints(&|_, e| e.len())),
        ("data/chunk_index".into(), ints(&|i, _| file(i) / chunk)),
        ("data/file_index".into(), ints(&|i, _| file(i) % chunk)),
        ("dataset_from_index".into(), ints(&|i, _| starts[i])),
        ("dataset_to_index".into(), ints(&|i, _| starts[i + 1])),
    ];
    for (at, (camera, _)) in recording.videos.iter().enumerate() {
        let seconds = |of: fn(&(usize, f64, f64)) -> f64| -> ArrayRef {
            let values = recording.episodes.iter().map(|e| of(&e.stretches[at]));
            Arc::new(Float64Array::from_iter_values(values))
        };
        for (name, column) in [
            ("chunk_index", ints(&|_, e| e.stretches[at].0 / chunk)),
            ("file_index", ints(&|_, e| e.stretches[at].0 % chunk)),
            ("from_timestamp", seconds(|stretch| stretch.1)),
            ("to_timestamp", seconds(|stretch| stretch.2)),
        ] {
            columns.push((format!("videos/{}/{name}", camera.name), column));
        }
    }
    let is_camera = |name: &str| recording.cameras().any(|camera| camera == name);
    columns.extend(statistics(written, &is_camera));
    for name in ["meta/episodes/chunk_index", "meta/episodes/file_index"] {
        columns.push((name.into(), ints(&|_, _| 0)));
    }
    write_table(path, columns, HashMap::new())
}

fn tasks(recording: &Recording) -> ListArray {
    let field = Field::new("element", DataType::Utf8, true);
    let mut lists = ListBuilder::new(StringBuilder::new()).with_field(field);
    for episode in &recording.episodes {
        for &task in &episode.tasks {
            lists.values().append_value(&recording.tasks[task]);
        }
        lists.append(true);
    }
    lists.finish()
}

/// Columns `stats/FEATURE/NAME` of the episodes.
fn statistics(
    written: &[WrittenEpisode],
    is_camera: &dyn Fn(&str) -> bool,
) -> Vec<(String, ArrayRef)> {
    let mut columns: Vec<(String, ArrayRef)> = Vec::new();
    let first = written.first().map(|episode| &episode.statistics);
    for feature in first.into_iter().flat_map(BTreeMap::keys) {
        let each = written.iter().filter_map(|e| e.statistics.get(feature));
        let each: Vec<&Statistics> = each.collect();
        let mut values: BTreeMap<&str, Vec<&[f64]>> = BTreeMap::new();
        let mut names = Vec::new();
        for (name, of_episode) in each.iter().flat_map(|episode| episode.entries()) {
            values.entry(name).or_insert_with(|| {
                names.push(name);
                Vec::new()
            });
            values.entry(name).or_default().push(of_episode);
        }
        for name in names {
            let column = lists(&values[name], is_camera(feature));
            columns.push((format!("stats/{feature}/{name}"), column));
        }
        let counts = each.iter().map(|e| Some([Some(e.count as i64)]));
        let counts = ListArray::from_iter_primitive::<arrow_array::types::Int64Type, _, _>(counts);
        columns.push((format!("stats/{feature}/count"), Arc::new(counts)));
    }
    columns
}

/// A list of numbers per episode, of equal length. For pictures the shape is `(3, 1, 1)`.
fn lists(rows: &[&[f64]], of_pictures: bool) -> ArrayRef {
    let values = rows.iter().flat_map(|row| row.iter().copied());
    let mut column: ArrayRef = Arc::new(Float64Array::from_iter_values(values));
    if of_pictures {
        column = listed(listed(column, 1), 1);
    }
    listed(column, rows.first().map_or(1, |row| row.len()))
}

fn listed(values: ArrayRef, len: usize) -> ArrayRef {
    let field = Field::new("element", values.data_type().clone(), true);
    let lists = FixedSizeListArray::new(Arc::new(field), len as i32, values, None);
    Arc::new(ListArray::from(lists))
}
