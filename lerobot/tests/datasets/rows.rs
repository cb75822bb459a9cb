//! Rows that are wrong, repeated, or at the wrong times.

use std::fs;
use std::sync::Arc;

use arrow_array::{Float32Array, Float64Array, Int64Array, RecordBatch};
use zk0_lerobot::dataset::{Dataset, DatasetError, Repair};
use zk0_testkit::recordings::{open, with_column, Copy, DATA, INFO};

#[test]
fn rows_that_do_not_fit() {
    let copy = Copy::default();
    copy.edit_rows(|rows| rows.slice(0, 235));
    copy.fails(DATA, "ends after 235 frames, meta/info.json declares 245");

    let copy = Copy::default();
    copy.edit_rows(|rows| rows.slice(1, 244));
    copy.fails(
        DATA,
        "index 1 found where the episodes' metadata expects index 0",
    );

    let copy = Copy::default();
    copy.edit_rows(|rows| {
        let ones = Float32Array::from(vec![1.0; rows.num_rows()]);
        with_column(rows, "action", Arc::new(ones))
    });
    copy.fails(
        DATA,
        "column action holds Float32, expected lists of numbers",
    );

    let copy = Copy::default();
    copy.edit_rows(|rows| {
        let gaps: Float32Array = (0..rows.num_rows())
            .map(|i| (i != 9).then_some(0.0))
            .collect();
        with_column(rows, "timestamp", Arc::new(gaps))
    });
    copy.fails(DATA, "column timestamp has empty cells");

    let copy = Copy::default();
    copy.edit_rows(|rows| {
        let at = rows.schema().index_of("task_index").unwrap();
        let mut rows = rows;
        rows.remove_column(at);
        rows
    });
    copy.fails(DATA, "has no column \"task_index\"");

    let copy = Copy::default();
    copy.edit_text(INFO, "                6", "                7");
    let error = copy.error().to_string();
    assert!(error.contains("7 dimensions"), "{error}");
}

#[test]
fn values_that_are_not_finite() {
    use arrow_array::cast::AsArray;
    use arrow_array::types::Float32Type;
    use arrow_array::{Array, FixedSizeListArray};
    let copy = Copy::default();
    copy.edit_rows(|rows| {
        let states = rows
            .column_by_name("observation.state")
            .unwrap()
            .as_fixed_size_list();
        let mut values = states
            .values()
            .as_primitive::<Float32Type>()
            .values()
            .to_vec();
        values[6 * 50 + 3] = f32::NAN;
        let arrow_schema::DataType::FixedSizeList(field, dim) = states.data_type() else {
            panic!()
        };
        let values = Arc::new(Float32Array::from(values));
        let states = FixedSizeListArray::new(field.clone(), *dim, values, None);
        with_column(rows, "observation.state", Arc::new(states))
    });
    copy.fails(DATA, "row 50: observation.state holds NaN in dimension 3");
}

/// Reads all frames without their pictures.
fn motion(dataset: &Dataset) -> Vec<zk0_lerobot::dataset::Frame> {
    let loader = dataset.loader(10).unwrap();
    (0..dataset.len())
        .map(|i| loader.motion(i).unwrap())
        .collect()
}

#[track_caller]
fn repaired(copy: &Copy, like: &str, file: &str, rows: usize, first: usize) {
    let dataset = copy.open().unwrap();
    assert_eq!(motion(&dataset), motion(&open(like)));
    let path = copy.path(file);
    assert_eq!(
        dataset.repairs(),
        [Repair::RepeatedRows { path, rows, first }]
    );
}

#[test]
fn frames_stored_twice_are_read_once() {
    // LeRobot meets such recordings (issue 1875). `faults.json` states that LeRobot never reads the second half.
    let dataset = open("so100_stacking_doubled");
    assert_eq!(motion(&dataset), motion(&open("so100_stacking")));
    let [repair @ Repair::RepeatedRows {
        rows: 249,
        first: 249,
        ..
    }] = dataset.repairs()
    else {
        panic!("{:?}", dataset.repairs())
    };
    let note = repair.to_string();
    assert!(
        note.contains(
            "so100_stacking_doubled/data/chunk-000/file-000.parquet: 249 rows repeat frames"
        ),
        "{note}"
    );
    assert!(open("so100_stacking").repairs().is_empty());
    // The frames are the same with pictures, too.
    let (ours, like) = (
        dataset.frame(248, 10).unwrap(),
        open("so100_stacking").frame(248, 10).unwrap(),
    );
    assert!(ours == like);
}

#[test]
fn other_ways_of_repeating_rows_are_repaired_too() {
    // Every row comes three times in a row.
    let copy = Copy::default();
    copy.edit_table(DATA, |rows| {
        (0..rows.num_rows() * 3)
            .map(|i| rows.slice(i / 3, 1))
            .collect()
    });
    repaired(&copy, "so100_pickplace", DATA, 245 * 2, 1);

    // The first episode comes a second time in the middle of the third.
    let copy = Copy::default();
    copy.edit_table(DATA, |rows| {
        vec![rows.slice(0, 100), rows.slice(0, 41), rows.slice(100, 145)]
    });
    repaired(&copy, "so100_pickplace", DATA, 41, 100);

    // The second file begins with the rows of the file before it.
    let copy = Copy::of("so100_sorting");
    let first = fs::read(copy.path(DATA)).unwrap();
    let (before, second) = (
        copy.path("before.parquet"),
        "data/chunk-000/file-001.parquet",
    );
    fs::write(&before, first).unwrap();
    let mut early = Vec::new();
    copy.edit_table("before.parquet", |rows| {
        early.push(rows.clone());
        vec![rows]
    });
    copy.edit_table(second, |rows| vec![early[0].clone(), rows]);
    repaired(&copy, "so100_sorting", second, early[0].num_rows(), 0);

    // In v2.1, one episode's file holds its rows twice.
    let copy = Copy::of("so100_pickplace_v21");
    let file = "data/chunk-000/episode_000002.parquet";
    copy.edit_table(file, |rows| vec![rows.clone(), rows]);
    repaired(&copy, "so100_pickplace_v21", file, 44, 44);
}

/// Rebuilds the rows with the schema that [`with_column`] gives.
fn rebuilt(rows: &RecordBatch) -> RecordBatch {
    let index = rows.column_by_name("index").unwrap().clone();
    with_column(rows.clone(), "index", index)
}

#[test]
fn copies_that_differ_are_not_taken_for_repetitions() {
    let tail = |rows: &RecordBatch| rows.slice(0, 3);
    let ints = |values: [i64; 3]| Arc::new(Int64Array::from(values.to_vec()));
    let floats = |values: [f32; 3]| Arc::new(Float32Array::from(values.to_vec()));
    let cases: [(&str, arrow_array::ArrayRef); 4] = [
        ("frame_index", ints([0, 5, 2])),
        ("episode_index", ints([0, 1, 0])),
        ("task_index", ints([0, 1, 0])),
        ("timestamp", floats([0.0, 0.1, 2.0 / 30.0])),
    ];
    for (column, values) in cases {
        let copy = Copy::default();
        copy.edit_table(DATA, |rows| {
            let again = with_column(tail(&rows), column, values);
            vec![rebuilt(&rows), again]
        });
        let error = copy.error();
        assert!(
            matches!(
                error,
                DatasetError::RepeatedFrame {
                    row: 246,
                    index: 1,
                    ..
                }
            ),
            "{column}: {error}"
        );
    }
    for column in ["action", "observation.state"] {
        let copy = Copy::default();
        copy.edit_table(DATA, |rows| {
            let other = rows.column_by_name(column).unwrap().slice(7, 3);
            vec![rebuilt(&rows), with_column(tail(&rows), column, other)]
        });
        let error = copy.error();
        assert!(
            matches!(
                error,
                DatasetError::RepeatedFrame {
                    row: 245,
                    index: 0,
                    ..
                }
            ),
            "{column}: {error}"
        );
    }
}

#[test]
fn episodes_described_twice_are_read_once() {
    let file = "meta/episodes/chunk-000/file-000.parquet";
    let again = "meta/episodes/chunk-000/file-001.parquet";
    let copy = Copy::default();
    fs::copy(copy.path(file), copy.path(again)).unwrap();
    let dataset = copy.open().unwrap();
    let path = copy.path(again);
    assert_eq!(
        dataset.repairs(),
        [Repair::RepeatedEpisodes { path, rows: 6 }]
    );
    assert_eq!(motion(&dataset), motion(&open("so100_pickplace")));

    // The second description of the episodes differs only in the time in the video.
    copy.edit_table(again, |rows| {
        let column = "videos/observation.images.top/from_timestamp";
        let later = Float64Array::from(vec![0.5; rows.num_rows()]);
        vec![with_column(rows, column, Arc::new(later))]
    });
    copy.fails(again, "expected episode 6 of 6");

    let copy = Copy::of("so100_pickplace_v21");
    let lines = "meta/episodes.jsonl";
    copy.edit(lines, |bytes| [&bytes[..], b"\n", &bytes[..]].concat());
    let dataset = copy.open().unwrap();
    let path = copy.path(lines);
    assert_eq!(
        dataset.repairs(),
        [Repair::RepeatedEpisodes { path, rows: 6 }]
    );
}

#[test]
fn timestamps_off_the_frame_grid_are_named() {
    let error = Dataset::open(zk0_testkit::recordings::recording(
        "so100_pickplace_bad_timestamps",
    ))
    .unwrap_err();
    assert!(
        matches!(
            error,
            DatasetError::Timestamp {
                episode: 2,
                frame: 10,
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn timestamps_off_the_frame_grid_are_named_in_v21_too() {
    let copy = Copy::of("so100_pickplace_v21");
    let file = "data/chunk-000/episode_000004.parquet";
    let off_by = |seconds: f32| {
        copy.edit_table(file, |rows| {
            let times =
                (0..rows.num_rows()).map(|i| i as f32 / 30.0 + if i == 5 { seconds } else { 0.0 });
            let times: Float32Array = times.map(Some).collect();
            vec![with_column(rows, "timestamp", Arc::new(times))]
        });
    };
    off_by(0.01);
    let error = copy.error();
    assert!(
        matches!(
            error,
            DatasetError::Timestamp {
                episode: 4,
                frame: 5,
                ..
            }
        ),
        "{error}"
    );
    assert!(error
        .to_string()
        .contains(&format!("{}: episode 4 frame 5", copy.path(file).display())));
    off_by(0.00011);
    assert!(copy.open().is_err());
    off_by(0.00009);
    assert!(copy.open().is_ok());
}
