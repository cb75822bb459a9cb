//! Recordings that LeRobot 0.6.1 was ended in the middle of (see the fixtures' README): what is saved of them, what is stated to be lost,
//! and where `recover` is named.

mod advice;
mod damaged;
mod encoded;
mod merges;
mod pictures;
mod refusals;
mod statistics;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::types::Float32Type;
use arrow_array::{Array, FixedSizeListArray, Float32Array, RecordBatch};
use arrow_schema::DataType;
use openh264::encoder::Profile;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use tempfile::TempDir;
use zk0_lerobot::dataset::{recover, Dataset, DatasetError, Lost, Recovered};
use zk0_testkit::recordings::mp4_writer::encode;
use zk0_testkit::recordings::{frames, recording, Copy, DATA, INFO, STATS, TOP};

/// A recording of the fixtures that ended too early, or the one that did not (`finished`).
fn unfinished(name: &str) -> PathBuf {
    recording(&format!("../unfinished_recordings/{name}"))
}

fn copy_of(name: &str) -> Copy {
    Copy::of(&format!("../unfinished_recordings/{name}"))
}

/// A folder for new folders.
struct Out(TempDir);

impl Out {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self) -> PathBuf {
        self.0.path().join("saved")
    }

    /// What lies beside the new folder: nothing may be left there.
    fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(self.0.path()).unwrap();
        entries
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect()
    }

    fn of(&self, from: &Path) -> (Recovered, Dataset) {
        let before = content(from);
        let report = recover(from, &self.path()).unwrap();
        assert_eq!(content(from), before, "the recording was changed");
        assert_eq!(self.names(), ["saved"]);
        (report, Dataset::open(self.path()).unwrap())
    }
}

/// Every file of a folder with its bytes.
fn content(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(content(&path));
        } else {
            found.push((path.clone(), fs::read(path).unwrap()));
        }
    }
    found.sort();
    found
}

/// Compares the saved episodes, numbered as they were recorded, with those of the finished recording: rows exactly, pictures up to
/// `levels` on average.
fn compare(saved: &Dataset, recorded: &[usize], levels: f64) {
    let finished = Dataset::open(unfinished("finished")).unwrap();
    let (new, old): (Vec<_>, Vec<_>) = (
        frames(saved, 3).map(Result::unwrap).collect(),
        frames(&finished, 3).map(Result::unwrap).collect(),
    );
    assert_eq!(saved.episodes().len(), recorded.len());
    let mut worst: f64 = 0.0;
    for (episode, &number) in saved.episodes().iter().zip(recorded) {
        let same = &finished.episodes()[number];
        assert_eq!(episode.frames.len(), same.frames.len());
        for (at, was) in episode.frames.clone().zip(same.frames.clone()) {
            let (new, old) = (&new[at], &old[was]);
            assert_eq!((&new.state, &new.actions), (&old.state, &old.actions));
            assert_eq!(new.task, old.task);
            for (new, old) in new.images.iter().zip(&old.images) {
                let pairs = new.pixels.iter().zip(&old.pixels);
                let sum: u64 = pairs.map(|(&a, &b)| u64::from(a.abs_diff(b))).sum();
                worst = worst.max(sum as f64 / new.pixels.len() as f64);
            }
        }
    }
    assert!(worst <= levels, "pictures differ by {worst} levels");
}

fn lost(report: &Recovered) -> Vec<String> {
    report.lost.iter().map(Lost::to_string).collect()
}

const NO_ROWS: &str =
    "episode 3: it has pictures and no rows; LeRobot keeps the rows in memory until an episode is saved";

#[test]
fn killed_in_an_episode_or_between_two() {
    for (name, expected) in [
        ("killed_in_episode", &[NO_ROWS][..]),
        ("killed_between_episodes", &[]),
    ] {
        let out = Out::new();
        let (report, saved) = out.of(&unfinished(name));
        compare(&saved, &[0, 1, 2], 0.0);
        assert_eq!(lost(&report), expected, "{name}");
        assert!(report.notes.is_empty(), "{:?}", report.notes);
        assert!(report.saved.iter().all(|e| !e.encoded_here));
    }
}

#[test]
fn killed_with_streaming_encoding() {
    let out = Out::new();
    let (report, saved) = out.of(&unfinished("killed_in_streaming"));
    compare(&saved, &[0, 1, 2], 0.0);
    // Of the fourth episode there is one video of each camera, without an index.
    assert_eq!((lost(&report).len(), report.notes.len()), (0, 2));
    for note in &report.notes {
        assert!(note.contains("_streaming.mp4: "), "{note}");
        assert!(note.ends_with("it is of an episode that was being recorded, and that is lost"));
    }
}

#[test]
fn killed_while_an_episode_is_encoded() {
    let out = Out::new();
    let (report, saved) = out.of(&unfinished("killed_in_encoding"));
    compare(&saved, &[0, 1, 2], LOSSY);
    let encoded: Vec<bool> = report.saved.iter().map(|e| e.encoded_here).collect();
    assert_eq!(encoded, [false, false, true]);
    // LeRobot's two videos were copied, and the third episode has one of its own.
    let codecs = |name| out.path().join(TOP.replace("file-000", name)).is_file();
    assert!(codecs("file-000") && codecs("file-001") && !codecs("file-002"));
}

#[test]
fn killed_while_videos_are_appended() {
    let out = Out::new();
    let (report, saved) = out.of(&unfinished("killed_in_appending"));
    // The second camera's video of the third episode lies in a temporary folder, and is taken as it is.
    compare(&saved, &[0, 1, 2], 0.0);
    assert_eq!(lost(&report).len(), 0);
    assert!(report.saved.iter().all(|e| !e.encoded_here));
}

#[test]
fn a_video_in_a_temporary_folder_is_of_its_episode_alone() {
    let video = "tmpztpimec4/observation.images.wrist_002.mp4";
    let changes: [&dyn Fn(&Copy); 2] = [
        // It is of another episode, or has other pictures than the episode has rows.
        &|copy| fs::rename(copy.path(video), copy.path(&video.replace("002", "001"))).unwrap(),
        &|copy| {
            let other = "videos/observation.images.wrist/chunk-000/file-000.mp4";
            fs::copy(unfinished("finished").join(other), copy.path(video)).unwrap();
        },
    ];
    for change in changes {
        let copy = copy_of("killed_in_appending");
        change(&copy);
        let out = Out::new();
        let (report, saved) = out.of(copy.root());
        compare(&saved, &[0, 1], 0.0);
        assert!(
            lost(&report)[0].starts_with("episode 2: "),
            "{:?}",
            report.lost
        );
    }
}

#[test]
fn pictures_that_were_not_all_written_are_no_episode() {
    let copy = copy_of("killed_in_batch");
    let last = "images/observation.images.top/episode-000000/frame-000004.png";
    fs::remove_file(copy.path(last)).unwrap();
    let out = Out::new();
    let (report, saved) = out.of(copy.root());
    compare(&saved, &[1, 2], LOSSY);
    let lost = lost(&report);
    assert!(lost[0].contains("left 4 of its pictures"), "{lost:?}");
}

#[test]
fn pictures_without_rows_are_said() {
    let copy = copy_of("killed_between_episodes");
    copy.edit(DATA, |bytes| bytes[..bytes.len() - 10].to_vec());
    let (report, _) = Out::new().of(copy.root());
    let mut notes = report.notes.iter();
    assert!(
        notes.any(|note| note.contains("pictures more than there are rows")),
        "{:?}",
        report.notes
    );
}

#[test]
fn killed_or_ended_before_a_batch_is_encoded() {
    for name in ["killed_in_batch", "ended_batch"] {
        let out = Out::new();
        let (report, saved) = out.of(&unfinished(name));
        compare(&saved, &[0, 1, 2], LOSSY);
        assert!(report.saved.iter().all(|e| e.encoded_here), "{name}");
        assert_eq!(lost(&report).len(), 0);
    }
}

/// Levels by which pictures that zk0 encoded may differ on average from those that LeRobot encoded. Both lose something.
const LOSSY: f64 = 3.0;

#[test]
fn a_recording_that_was_finished_stays_as_it_is() {
    for name in ["finished", "ended_streaming"] {
        let out = Out::new();
        let (report, saved) = out.of(&unfinished(name));
        let whole = Dataset::open(unfinished(name)).unwrap();
        let all: Vec<usize> = (0..whole.episodes().len()).collect();
        compare(&saved, &all, 0.0);
        assert_eq!((lost(&report).len(), report.notes.len()), (0, 0));
        for (new, old) in [
            (&saved.stats().state, &whole.stats().state),
            (&saved.stats().action, &whole.stats().action),
        ] {
            let moments = |n: &zk0_lerobot::dataset::Normalizer| {
                [n.mean().to_vec(), n.std().to_vec()].concat()
            };
            for (new, old) in moments(new).iter().zip(moments(old)) {
                assert!((new - old).abs() < 1e-3, "{new} {old}");
            }
        }
        assert_eq!(saved.feature_spec(10), whole.feature_spec(10));
    }
}

/// LeRobot 0.6.1's `meta/stats.json` of the finished recording, beside that of the saved one.
#[test]
fn statistics_are_lerobots() {
    let out = Out::new();
    out.of(&unfinished("finished"));
    let read = |root: &Path| -> serde_json::Value {
        serde_json::from_slice(&fs::read(root.join(STATS)).unwrap()).unwrap()
    };
    let (new, old) = (read(&out.path()), read(&unfinished("finished")));
    let numbers = |value: &serde_json::Value| -> Vec<f64> {
        let list = value.as_array().unwrap();
        list.iter().map(|v| v.as_f64().unwrap()).collect()
    };
    for (feature, old) in old.as_object().unwrap() {
        let new = &new[feature];
        // These are of what the videos show, and LeRobot's of what the cameras gave: see `statistics`.
        if feature.starts_with("observation.images") {
            continue;
        }
        assert_eq!(
            new.as_object().unwrap().len(),
            old.as_object().unwrap().len()
        );
        for (name, old_values) in old.as_object().unwrap() {
            let (min, max) = (numbers(&old["min"]), numbers(&old["max"]));
            for (d, (a, b)) in numbers(&new[name])
                .iter()
                .zip(numbers(old_values))
                .enumerate()
            {
                // A bin of the histogram is a 5000th of the range.
                let tolerance = ((max[d] - min[d]) / 2000.0).max(1e-4);
                assert!((a - b).abs() <= tolerance, "{feature} {name}: {a} {b}");
            }
        }
    }
}

#[test]
fn data_cut_anywhere_saves_the_episodes_before_the_cut() {
    let mut saved_before = 0;
    let copy = copy_of("killed_between_episodes");
    let whole = fs::read(copy.path(DATA)).unwrap();
    for len in (0..=whole.len()).step_by(61).chain([whole.len()]) {
        copy.edit(DATA, |_| whole[..len].to_vec());
        let out = Out::new();
        match recover(copy.root(), &out.path()) {
            Ok(report) => {
                let recorded: Vec<usize> = report
                    .saved
                    .iter()
                    .map(|e| e.recorded_as as usize)
                    .collect();
                assert_eq!(recorded, (0..recorded.len()).collect::<Vec<_>>());
                assert!(recorded.len() >= saved_before);
                saved_before = recorded.len();
            }
            Err(error) => {
                assert_eq!(saved_before, 0, "{len}: {error}");
                assert_eq!(out.names().len(), 0);
            }
        }
    }
    assert_eq!(saved_before, 3);
}

#[test]
fn damaged_bytes_end_in_an_error_or_in_whole_episodes() {
    let copy = copy_of("killed_between_episodes");
    let whole = fs::read(copy.path(DATA)).unwrap();
    for at in (0..whole.len()).step_by(23) {
        copy.edit(DATA, |_| {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x55;
            bytes
        });
        let out = Out::new();
        if recover(copy.root(), &out.path()).is_ok() {
            Dataset::open(out.path()).unwrap();
        } else {
            assert_eq!(out.names().len(), 0);
        }
    }
}

#[test]
fn an_episode_without_its_pictures_is_lost_and_the_others_are_renumbered() {
    let copy = copy_of("killed_in_batch");
    fs::remove_file(copy.path("images/observation.images.wrist/episode-000001/frame-000002.png"))
        .unwrap();
    let out = Out::new();
    let (report, saved) = out.of(copy.root());
    compare(&saved, &[0, 2], LOSSY);
    assert_eq!(
        lost(&report),
        ["episode 1: 4 rows, and observation.images.wrist left none of its pictures: its video was not finished"]
    );
}

#[test]
fn an_episode_with_a_number_that_is_not_finite_is_lost() {
    let copy = copy_of("finished");
    copy.edit_rows(|rows| {
        let states = rows["observation.state"].as_fixed_size_list();
        let mut values = states
            .values()
            .as_primitive::<Float32Type>()
            .values()
            .to_vec();
        values[5 * 6] = f32::NAN; // the first frame of episode 1
        let DataType::FixedSizeList(element, dim) = states.data_type() else {
            panic!("states are {}", states.data_type())
        };
        let values = Arc::new(Float32Array::from(values));
        let states = FixedSizeListArray::new(element.clone(), *dim, values, None);
        let mut columns = rows.columns().to_vec();
        columns[rows.schema().index_of("observation.state").unwrap()] = Arc::new(states);
        RecordBatch::try_new(rows.schema(), columns).unwrap()
    });
    let out = Out::new();
    let (report, saved) = out.of(copy.root());
    compare(&saved, &[0, 2, 3], 0.0);
    assert_eq!(
        lost(&report),
        ["episode 1: frame 0 holds a number that is not finite"]
    );
}

/// The videos still have the pictures of the missing rows, so that the episodes after them would get wrong ones.
#[test]
fn rows_that_are_missing_lose_the_episodes_after_them() {
    let copy = copy_of("finished");
    copy.edit_table(DATA, |rows| {
        vec![rows.slice(0, 6), rows.slice(7, rows.num_rows() - 7)]
    });
    let out = Out::new();
    let (report, saved) = out.of(copy.root());
    compare(&saved, &[0], 0.0);
    let lost = lost(&report);
    assert_eq!(lost[0], "episode 1: it has frame 2 where frame 1 is due");
    assert!(lost[1].starts_with("episode 2: rows of an episode before it are missing"));
    assert_eq!(lost.len(), 3);
}

/// pandas finds the index of a table here, and LeRobot finds the tasks by it.
#[test]
fn the_table_of_tasks_says_which_column_is_its_index() {
    let out = Out::new();
    out.of(&unfinished("killed_between_episodes"));
    let file = fs::File::open(out.path().join("meta/tasks.parquet")).unwrap();
    let table = ParquetRecordBatchReaderBuilder::try_new(file).unwrap();
    let pandas: serde_json::Value =
        serde_json::from_str(&table.schema().metadata()["pandas"]).unwrap();
    assert_eq!(pandas["index_columns"], serde_json::json!(["task"]));
}

#[test]
fn a_video_without_the_last_episode_loses_that_one() {
    let copy = copy_of("killed_between_episodes");
    // In this one the third episode was not encoded yet.
    fs::copy(unfinished("killed_in_encoding").join(TOP), copy.path(TOP)).unwrap();
    let out = Out::new();
    let (report, saved) = out.of(copy.root());
    compare(&saved, &[0, 1], 0.0);
    assert_eq!(
        lost(&report),
        ["episode 2: 6 rows, and observation.images.top left none of its pictures: its video was not finished"]
    );
}

/// LeRobot copies a video over the one before where the two are on different disks.
#[test]
fn a_video_that_was_being_copied_loses_its_episodes() {
    let copy = copy_of("killed_in_encoding");
    copy.edit(TOP, |bytes| bytes[..bytes.len() - 100].to_vec());
    let out = Out::new();
    let (report, saved) = out.of(copy.root());
    compare(&saved, &[2], LOSSY);
    for (number, lost) in lost(&report).iter().enumerate() {
        assert!(lost.starts_with(&format!("episode {number}: ")), "{lost}");
        assert!(lost.ends_with("is it cut off?"), "{lost}");
    }
    assert_eq!(report.lost.len(), 2);
}

/// Streaming encoding drops pictures where it is too slow: here 14 are left for 15 rows, and nothing states of which episode.
#[test]
fn pictures_that_were_dropped_are_not_guessed() {
    let copy = copy_of("killed_in_streaming");
    let pictures = vec![vec![9; 3 * 64 * 64]; 14];
    let video = encode(&pictures, 64, 64, Profile::Baseline, 1).mp4(64, 64);
    fs::write(copy.path(TOP), video).unwrap();
    let out = Out::new();
    let error = recover(copy.root(), &out.path()).unwrap_err().to_string();
    let cause = "file-000.mp4 has 14 pictures, which do not fit the rows of its episodes";
    assert!(error.contains(cause), "{error}");
}

#[test]
fn recover_is_named_where_it_helps_and_nowhere_else() {
    for name in [
        "killed_in_episode",
        "killed_between_episodes",
        "killed_in_encoding",
        "killed_in_appending",
        "killed_in_batch",
        "ended_batch",
        "killed_in_streaming",
    ] {
        let root = unfinished(name);
        let error = Dataset::open(&root).unwrap_err().to_string();
        let command = format!("zk0 dataset recover {} --out NEW_FOLDER", root.display());
        assert!(error.contains(&command), "{name}: {error}");
        assert!(!error.contains("copy it again"), "{name}: {error}");
    }
    // With LeRobot's own settings, fewer than ten episodes leave no `meta/episodes`.
    let copy = copy_of("killed_between_episodes");
    fs::remove_dir_all(copy.path("meta/episodes")).unwrap();
    let error = copy.error().to_string();
    assert!(error.contains("zk0 dataset recover"), "{error}");
    // A copy that is incomplete, or a file that was damaged.
    for file in ["meta/episodes/chunk-000/file-000.parquet", DATA, TOP, STATS] {
        let copy = copy_of("finished");
        fs::remove_file(copy.path(file)).unwrap();
        let error = copy.error().to_string();
        assert!(!error.contains("recover"), "{file}: {error}");
    }
    // Pictures of an episode that was never saved are nothing that `recover` could save.
    let copy = copy_of("finished");
    fs::remove_file(copy.path("meta/episodes/chunk-000/file-000.parquet")).unwrap();
    fs::create_dir_all(copy.path("images/observation.images.top/episode-000004")).unwrap();
    let error = copy.error().to_string();
    assert!(!error.contains("recover"), "{error}");
}
