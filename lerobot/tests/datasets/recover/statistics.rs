//! The statistics of pictures, which LeRobot needs to record on in the new folder.

use serde_json::Value;
use zk0_testkit::recordings::fixtures;

use super::*;

const EPISODES: &str = "meta/episodes/chunk-000/file-000.parquet";
const CAMERAS: [&str; 2] = ["observation.images.top", "observation.images.wrist"];
/// What LeRobot computes of each colour.
pub const NAMES: [&str; 10] = [
    "min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99",
];

/// Numbers, and how deep they lie in lists.
type Found = (Vec<f64>, usize);

/// `meta/episodes` of a recording.
fn table(root: &Path) -> RecordBatch {
    let file = fs::File::open(root.join(EPISODES)).unwrap();
    let reader = ParquetRecordBatchReaderBuilder::try_new(file).unwrap();
    let mut batches = reader.with_batch_size(1 << 20).build().unwrap();
    let batch = batches.next().unwrap().unwrap();
    assert!(batches.next().is_none());
    batch
}

/// What an episode's cell of a column holds.
pub fn cell(table: &RecordBatch, camera: &str, name: &str, episode: usize) -> Found {
    let column = table.column_by_name(&format!("stats/{camera}/{name}"));
    of_cell(&column.unwrap().slice(episode, 1))
}

fn of_cell(cell: &dyn Array) -> Found {
    match cell.data_type() {
        DataType::List(_) => {
            let lists = cell.as_list::<i32>();
            within((0..lists.len()).map(|at| of_cell(&lists.value(at))))
        }
        DataType::Int64 => {
            let values = cell.as_primitive::<arrow_array::types::Int64Type>();
            (values.values().iter().map(|&v| v as f64).collect(), 0)
        }
        _ => {
            let values = cell.as_primitive::<arrow_array::types::Float64Type>();
            (values.values().to_vec(), 0)
        }
    }
}

fn of_json(value: &Value) -> Found {
    match value {
        Value::Array(values) => within(values.iter().map(of_json)),
        value => (vec![value.as_f64().unwrap()], 0),
    }
}

/// A list of these.
fn within(each: impl Iterator<Item = Found>) -> Found {
    let (mut all, mut deepest) = (Vec::new(), 0);
    for (values, depth) in each {
        all.extend(values);
        deepest = depth;
    }
    (all, deepest + 1)
}

/// LeRobot adds in float32, so that its deviations are less exact.
#[track_caller]
fn same(name: &str, ours: Found, theirs: Found) {
    assert_eq!((ours.0.len(), ours.1), (theirs.0.len(), theirs.1), "{name}");
    let slack = if name == "std" { 2e-4 } else { 1e-6 };
    for (ours, theirs) in ours.0.iter().zip(&theirs.0) {
        assert!((ours - theirs).abs() < slack, "{name}: {ours} {theirs}");
    }
}

/// Compares statistics of the pictures of episodes with those in a table that LeRobot wrote. Returns our table.
#[track_caller]
pub fn same_as_lerobots(
    ours: &Path,
    theirs: &Path,
    episodes: usize,
    names: &[&str],
) -> RecordBatch {
    let (ours, theirs) = (table(ours), table(theirs));
    for camera in CAMERAS {
        for (name, episode) in names
            .iter()
            .flat_map(|name| (0..episodes).map(move |e| (name, e)))
        {
            let of = |table| cell(table, camera, name, episode);
            same(name, of(&ours), of(&theirs));
        }
    }
    ours
}

#[test]
fn statistics_of_pictures_in_videos_are_those_that_lerobot_computes() {
    let text = fs::read(fixtures().join("unfinished_recordings/statistics.json")).unwrap();
    let given: Vec<Value> = serde_json::from_slice(&text).unwrap();
    for (recorded, episodes) in [("finished", 4), ("killed_between_episodes", 3)] {
        let out = Out::new();
        let (report, _) = out.of(&unfinished(recorded));
        assert!(report.notes.is_empty(), "{:?}", report.notes);
        let found = table(&out.path());
        assert_eq!(found.num_rows(), episodes);
        for (episode, theirs) in given[..episodes].iter().enumerate() {
            for camera in CAMERAS {
                for name in NAMES {
                    let ours = cell(&found, camera, name, episode);
                    // LeRobot's own deviation is 0 for one colour, where 0.0036 is right.
                    let given = if name == "std" { "std_float64" } else { name };
                    same(given, ours, of_json(&theirs[camera][given]));
                }
            }
        }
    }
}

/// LeRobot reads all tables of episodes as one, and goes on only where they have the same columns.
#[test]
fn meta_episodes_has_the_columns_that_lerobot_writes() {
    let columns = |root: &Path| -> Vec<String> {
        let table = table(root);
        let mut columns = Vec::new();
        for field in table.schema_ref().fields() {
            let (mut kind, mut lists) = (field.data_type(), 0);
            while let DataType::List(element) = kind {
                (kind, lists) = (element.data_type(), lists + 1);
            }
            columns.push(format!("{}: {kind} in {lists} lists", field.name()));
        }
        columns.sort();
        columns
    };
    for (name, like) in [
        ("killed_between_episodes", "finished"),
        ("pictures_killed_in_episode", "pictures_finished"),
    ] {
        let out = Out::new();
        out.of(&unfinished(name));
        assert_eq!(columns(&out.path()), columns(&unfinished(like)), "{name}");
    }
}

#[test]
fn statistics_of_all_episodes_are_those_that_lerobot_pools() {
    let name = "pictures_killed_in_episode";
    let out = Out::new();
    out.of(&unfinished(name));
    let read = |root: &Path| -> Value {
        serde_json::from_slice(&fs::read(root.join(STATS)).unwrap()).unwrap()
    };
    let (ours, theirs) = (read(&out.path()), read(&unfinished(name)));
    for camera in CAMERAS {
        for name in NAMES {
            let of = |all: &Value| of_json(&all[camera][name]);
            same(name, of(&ours), of(&theirs));
        }
    }
}

#[test]
fn pictures_that_do_not_decode_leave_their_camera_without_statistics() {
    let copy = copy_of("killed_between_episodes");
    copy.edit(TOP, |mut bytes| {
        let content = bytes.windows(4).position(|w| w == b"mdat").unwrap() + 4;
        bytes[content..content + 400].fill(0);
        bytes
    });
    let out = Out::new();
    let (report, _) = out.of(copy.root());
    let note = "there are no statistics of the pictures of observation.images.top, without which LeRobot cannot record on in the new \
         folder: videos/observation.images.top/chunk-000/file-000.mp4";
    assert!(report.notes[0].starts_with(note), "{:?}", report.notes);
    let found = table(&out.path());
    let has = |camera: &str| {
        let column = found.column_by_name(&format!("stats/{camera}/mean"));
        column.is_some()
    };
    assert_eq!(CAMERAS.map(has), [false, true]);
}
