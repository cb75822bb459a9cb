//! Metadata that is missing or wrong: each ends in an error that names the file and the cause.

mod statistics_fault;
mod v21;
mod variants;

use std::fs;
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::types::Int64Type;
use arrow_array::{ArrayRef, Float64Array, Int64Array, RecordBatch, StringArray};
use zk0_lerobot::dataset::{Dataset, DatasetError};
use zk0_testkit::recordings::{
    fixtures, open, recording, with_column, Copy, DATA, INFO, STATS, TOP,
};

const TASK_TABLE: &str = "meta/tasks.parquet";
const EPISODE_TABLE: &str = "meta/episodes/chunk-000/file-000.parquet";

#[test]
fn folder_and_files_that_are_not_there() {
    let error = Dataset::open(recording("nowhere")).unwrap_err().to_string();
    assert!(error.contains("nowhere: no such folder"), "{error}");

    let files = [INFO, STATS, TASK_TABLE, "meta/episodes", DATA, TOP];
    for file in files {
        let copy = Copy::default();
        let path = copy.path(file);
        if path.is_dir() {
            fs::remove_dir_all(path).unwrap();
        } else {
            fs::remove_file(path).unwrap();
        }
        assert!(
            matches!(copy.open(), Err(DatasetError::MissingFile { path }) if path == copy.path(file)),
            "{file}"
        );
    }
}

#[test]
fn broken_info() {
    let cases = [
        ("\"fps\"", "fps", "not the JSON"),
        ("\"fps\": 30", "\"fps\": 0", "fps is 0"),
        ("\"fps\": 30", "\"fps\": 1001", "fps is 1001"),
        (
            "\"observation.images.wrist\"",
            "\"observation.images.top\"",
            "feature \"observation.images.top\" is there twice",
        ),
        (
            "\"fps\": 30",
            "\"fps\": -1",
            "-1 where a whole number is expected",
        ),
        ("\"fps\": 30", "\"frames\": 30", "missing field `fps`"),
        ("codebase_version", "version", "no codebase_version"),
        (
            "\"total_frames\": 245",
            "\"total_frames\": 1000000000000",
            "total_frames is 1000000000000",
        ),
        (
            "\"total_frames\": 245",
            "\"total_frames\": 0",
            "total_frames is 0",
        ),
        (
            "\"total_episodes\": 6",
            "\"total_episodes\": 99999999999",
            "total_episodes is 99999999999",
        ),
        ("\"action\":", "\"motion\":", "no feature action"),
        (
            "\"observation.state\":",
            "\"observation.stat\":",
            "no feature observation.state",
        ),
        ("\"float32\"", "\"string\"", "action is \"string\""),
        (
            "                6",
            "                600000000",
            "action has shape [600000000]",
        ),
        (
            "                96",
            "                960000000",
            "shape [960000000, 128, 3]",
        ),
        ("data/chunk-{", "../data/chunk-{", "path template"),
        (
            "{file_index:03d}.parquet",
            "{other}.parquet",
            "path template",
        ),
        ("videos/{video_key}", "/{video_key}", "path template"),
    ];
    for (from, to, cause) in cases {
        let copy = Copy::default();
        copy.edit_text(INFO, from, to);
        copy.fails(INFO, cause);
    }
    let copy = Copy::default();
    copy.edit(INFO, |_| vec![b' '; 17 << 20]);
    copy.fails(INFO, "larger than");
}

#[test]
fn depth_cameras_are_named_and_not_read() {
    // LeRobot 0.6.1 writes more keys into `info`; the older key is that of LeRobot before.
    for key in ["is_depth_map", "video.is_depth_map"] {
        let copy = Copy::default();
        let describe = |reports: bool| {
            copy.edit(INFO, |bytes| {
                let mut info: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
                info["features"]["observation.images.depth"] = serde_json::json!({
                    "dtype": "video",
                    "shape": [96, 128, 1],
                    "names": ["height", "width", "channels"],
                    "info": {key: reports, "video.codec": "hevc", "video.pix_fmt": "gray12le"},
                });
                serde_json::to_vec(&info).unwrap()
            });
        };
        describe(true);
        let dataset = copy.open().unwrap();
        let whole = open("so100_pickplace");
        assert_eq!(dataset.info().depth_maps, ["observation.images.depth"]);
        assert_eq!(dataset.cameras(), whole.cameras());
        assert_eq!(dataset.feature_spec(10), whole.feature_spec(10));
        describe(false);
        copy.fails(INFO, "has shape [96, 128, 1]");
    }
    assert!(open("so100_pickplace").info().depth_maps.is_empty());
}

#[test]
fn counts_that_the_files_do_not_hold() {
    let copy = Copy::default();
    copy.edit_text(INFO, "\"total_frames\": 245", "\"total_frames\": 246");
    copy.fails("meta/episodes", "meta/info.json declares 6 with 246");
    let copy = Copy::default();
    copy.edit_text(INFO, "\"total_episodes\": 6", "\"total_episodes\": 5");
    copy.fails(
        "meta/episodes/chunk-000/file-000.parquet",
        "expected episode 5 of 5",
    );
}

/// A column, and what becomes of the number in each row of it.
type Change = (&'static str, fn(usize, i64) -> i64);

/// The table of the episodes with other numbers in these columns, row by row.
fn episodes_with(changes: &[Change]) -> Copy {
    let copy = Copy::default();
    copy.edit_table(EPISODE_TABLE, |mut table| {
        for (name, change) in changes {
            let column = table.column_by_name(name).unwrap();
            let numbers = column.as_primitive::<Int64Type>().values();
            let numbers = numbers.iter().enumerate().map(|(row, n)| change(row, *n));
            let column = Arc::new(Int64Array::from_iter_values(numbers));
            table = with_column(table, name, column);
        }
        vec![table]
    });
    copy
}

#[test]
fn episodes_that_do_not_follow_each_other() {
    let last = |row, n| if row == 5 { n + 1 } else { n };
    let second = |row, n| if row == 1 { n + 1 } else { n };
    let none = |row, n| if row == 1 { 0 } else { n };
    let back = |row, n| if row == 1 { n - 38 } else { n };
    let changes: [(&[Change], &str); 5] = [
        (&[("episode_index", second)], "expected episode 1 of 6"),
        (
            &[
                ("dataset_from_index", second),
                ("length", |row, n| if row == 1 { n - 1 } else { n }),
            ],
            "expected episode 1 of 6",
        ),
        (&[("length", second)], "expected episode 1 of 6"),
        (
            &[("dataset_to_index", back), ("length", none)],
            "expected episode 1 of 6",
        ),
        (
            &[("dataset_to_index", last), ("length", last)],
            "expected episode 5 of 6",
        ),
    ];
    for (change, cause) in changes {
        episodes_with(change).fails(EPISODE_TABLE, cause);
    }
    let copy = Copy::default();
    copy.edit_text(INFO, "\"total_episodes\": 6", "\"total_episodes\": 7");
    copy.fails("meta/episodes", "describes 6 episodes with 245 frames");

    let copy = Copy::default();
    let name = "videos/observation.images.top/from_timestamp";
    copy.edit_table(EPISODE_TABLE, |table| {
        let times = Float64Array::from_iter_values((0..table.num_rows()).map(|_| f64::NAN));
        vec![with_column(table, name, Arc::new(times))]
    });
    copy.fails(EPISODE_TABLE, "from_timestamp is NaN");
}

/// LeRobot 0.6.1 wrote these tables (see the fixtures' README): a new one, and one of LeRobot 0.4.4 that it added a task to.
#[test]
fn task_tables_of_a_newer_lerobot() {
    let older = open("so100_sorting");
    let copy = Copy::of("so100_sorting");
    let replace = |table: &str| {
        let table = fixtures().join("lerobot_0_6_1").join(table);
        fs::copy(table, copy.path(TASK_TABLE)).unwrap();
    };
    replace("tasks.parquet");
    assert_eq!(copy.open().unwrap().tasks(), older.tasks());

    replace("tasks_added.parquet");
    copy.edit_text(INFO, "\"total_tasks\": 2", "\"total_tasks\": 3");
    let added = copy.open().unwrap();
    assert_eq!(&added.tasks()[..2], older.tasks());
    assert_eq!(added.tasks()[2], "Put both cubes on the red plate.");
}

#[test]
fn task_strings_in_two_columns_or_in_none() {
    let index = "__index_level_0__";
    let table_with = |names: &[&str]| {
        let copy = Copy::default();
        copy.edit_table(TASK_TABLE, |table| {
            let column = |name: &str| table.column_by_name(name).unwrap().clone();
            let strings = names.iter().map(|name| (*name, column(index)));
            let columns = strings.chain([("task_index", column("task_index"))]);
            vec![RecordBatch::try_from_iter(columns).unwrap()]
        });
        copy
    };
    for name in [index, "task"] {
        let tasks = table_with(&[name]).open().unwrap().tasks().to_vec();
        assert_eq!(tasks, open("so100_pickplace").tasks(), "{name}");
    }
    let both = "has two columns of task strings, \"task\" and \"__index_level_0__\"";
    table_with(&["task", index]).fails(TASK_TABLE, both);
    let neither = "has no column of task strings: LeRobot 0.5 and later write \"task\", LeRobot 0.4 wrote \"__index_level_0__\"";
    table_with(&["tasks"]).fails(TASK_TABLE, neither);
}

/// A small file can hold very many of them.
#[test]
fn tasks_without_number_are_refused() {
    let copy = Copy::default();
    copy.edit_table(TASK_TABLE, |_| {
        let count = 1 << 19;
        let numbers: ArrayRef = Arc::new(Int64Array::from_iter_values(0..count));
        let texts: ArrayRef = Arc::new(StringArray::from(vec![""; count as usize]));
        let columns = [("task_index", numbers), ("task", texts)];
        vec![RecordBatch::try_from_iter(columns).unwrap()]
    });
    copy.fails(TASK_TABLE, "holds more than 16777216 bytes");
}

#[test]
fn an_older_format_is_told_how_to_convert() {
    let copy = Copy::of("so100_pickplace_v21");
    copy.edit_text(INFO, "\"v2.1\"", "\"v1.6\"");
    let error = copy.error();
    assert!(
        matches!(&error, DatasetError::Version { found, .. } if found == "v1.6"),
        "{error}"
    );
    assert!(error.to_string().contains("convert_dataset_v21_to_v30"));
}

#[test]
fn broken_stats() {
    let copy = Copy::default();
    copy.edit(STATS, |bytes| bytes[..bytes.len() / 2].to_vec());
    copy.fails(STATS, "not the JSON");

    let damage = |change: fn(&mut serde_json::Value), cause| {
        let copy = Copy::default();
        copy.edit(STATS, |bytes| {
            let mut stats = serde_json::from_slice(&bytes).unwrap();
            change(&mut stats);
            serde_json::to_vec(&stats).unwrap()
        });
        copy.fails(STATS, cause);
    };
    damage(
        |s| s["action"]["std"][2] = (-1.0).into(),
        "action: standard deviation 2 is -1; it has to be",
    );
    damage(
        |s| s["action"]["std"][2] = 1e300.into(),
        "action: standard deviation 2 is inf",
    );
    damage(
        |s| s["action"]["mean"] = vec![0.0; 5].into(),
        "action: 5 means",
    );
    damage(|s| s["observation.state"] = 1.into(), "observation.state: ");
    damage(
        |s| drop(s.as_object_mut().unwrap().remove("action")),
        "no statistics of action",
    );
}

#[test]
fn cameras_may_be_described_channels_first() {
    let copy = Copy::of("so100_pickplace_v21");
    copy.edit(INFO, |bytes| {
        let mut info: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
        let top = &mut info["features"]["observation.images.top"];
        top["shape"] = serde_json::json!([3, 96, 128]);
        top["names"] = serde_json::json!(["channel", "height", "width"]);
        serde_json::to_vec(&info).unwrap()
    });
    let dataset = copy.open().unwrap();
    let top = dataset
        .cameras()
        .iter()
        .find(|c| c.name.ends_with("top"))
        .unwrap();
    assert_eq!((top.height, top.width), (96, 128));

    // The names contradict the shape.
    copy.edit_text(
        INFO,
        "[\"channel\",\"height\",\"width\"]",
        "[\"height\",\"width\",\"channel\"]",
    );
    copy.fails(INFO, "has shape [3, 96, 128]");
}
