//! Videos that do not fit their rows. LeRobot made the folders and gave the right pictures: see the fixtures' README, "videos_and_rows".

use std::fs;
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::types::Float64Type;
use arrow_array::{Float64Array, RecordBatch};
use zk0_lerobot::dataset::{Dataset, DatasetError, Repair};
use zk0_testkit::recordings::{fixtures, open, recording, with_column, Copy, DATA, INFO, TOP};

use super::picture_digests::{expected, pictures};

const EPISODES: &str = "meta/episodes/chunk-000/file-000.parquet";
const TOP_TO: &str = "videos/observation.images.top/to_timestamp";
const WRIST: &str = "observation.images.wrist";
const DROPPED: &str = "../videos_and_rows/dropped_pictures";

fn recorded(dataset: &Dataset) -> Vec<usize> {
    dataset.episodes().iter().map(|e| e.recorded).collect()
}

/// Episode, pictures and rows of what was left out.
fn left_out(dataset: &Dataset) -> Vec<(usize, usize, usize)> {
    let all = dataset.left_out().iter();
    all.map(|e| (e.episode, e.pictures, e.rows)).collect()
}

fn merged(camera: &str, episodes: usize) -> Repair {
    Repair::MergedVideos {
        camera: format!("observation.images.{camera}"),
        episodes,
    }
}

/// LeRobot 0.6.1 gives 31 and 38 of the 58 rows right.
#[test]
fn merges_that_lerobot_0_4_0_described_wrongly_are_read_in_order() {
    let few = open("../videos_and_rows/merged_in_few_files");
    assert_eq!(few.repairs(), [merged("wrist", 2)]);
    let many = open("../videos_and_rows/merged_in_many_files");
    assert_eq!(many.repairs(), [merged("top", 1), merged("wrist", 1)]);
    for dataset in [few, many] {
        let lengths: Vec<_> = dataset.episodes().iter().map(|e| e.frames.len()).collect();
        assert_eq!(lengths, [12, 9, 20, 10, 7]);
        assert!(pictures(&dataset) == expected("merged"));
        assert!(dataset.left_out().is_empty());
    }
}

#[test]
fn a_merge_whose_files_are_not_filled_exactly_is_refused() {
    let copy = Copy::of("../videos_and_rows/merged_in_many_files");
    let file = |n| format!("videos/observation.images.top/chunk-000/file-00{n}.mp4");
    // Ten pictures in place of seven.
    fs::copy(copy.path(&file(2)), copy.path(&file(3))).unwrap();
    let error = copy.error();
    let DatasetError::SharedPictures {
        path,
        first: 2,
        second: 3,
        ..
    } = &error
    else {
        panic!("{error}")
    };
    assert_eq!(*path, copy.path(&file(2)));
    assert!(error.to_string().contains("LeRobot 0.4.3"), "{error}");
    // A file more than is filled.
    let copy = Copy::of("../videos_and_rows/merged_in_many_files");
    fs::copy(copy.path(&file(3)), copy.path(&file(4))).unwrap();
    assert!(matches!(copy.error(), DatasetError::SharedPictures { .. }));
}

/// LeRobot 0.6.1 trains on episode 1: its rows 5 to 19 have later pictures.
#[test]
fn an_episode_with_dropped_pictures_is_left_out() {
    let dataset = open(DROPPED);
    assert_eq!(left_out(&dataset), [(1, 17, 20)]);
    let note = dataset.left_out()[0].to_string();
    assert!(
        note.contains(
            "episode 1 is left out: camera observation.images.top has 17 pictures for its 20 rows"
        ),
        "{note}"
    );
    let surplus = Repair::SurplusPictures {
        camera: WRIST.into(),
        episodes: 1,
        first: 2,
        pictures: 10,
        rows: 8,
    };
    assert_eq!(dataset.repairs(), [surplus]);
    // The others are as LeRobot gives them, and tile the frames.
    let right = expected("dropped_pictures");
    assert!(pictures(&dataset) == [&right[..10], &right[30..]].concat());
    assert_eq!(recorded(&dataset), [0, 2]);
    let tiles: Vec<_> = dataset
        .episodes()
        .iter()
        .map(|e| (e.index, e.frames.clone()))
        .collect();
    assert_eq!(tiles, [(0, 0..10), (1, 10..18)]);
    let base = open("so100_pickplace_v21");
    for (frame, of_base) in (0..10).chain(30..38).enumerate() {
        assert_eq!(dataset.state(frame), base.state(of_base));
        assert_eq!(dataset.action(frame), base.action(of_base));
    }
    assert_eq!(dataset.len(), 18);
    let last = dataset.frame(17, 3).unwrap();
    assert_eq!((last.episode, last.frame), (1, 7));
    assert_eq!(last.timestamp, 7.0 / 30.0);
    assert_eq!(dataset.frames_per_task(), [18]);
    assert_eq!(dataset.episode_digests().count(), 2);
    assert!(dataset.picture_faults(|_, _| {}).is_empty());
}

/// A picture that cannot be had names the episode as the files number it.
#[test]
fn numbers_in_errors_are_those_of_the_files() {
    let copy = Copy::of(DROPPED);
    let dataset = copy.open().unwrap();
    fs::remove_file(copy.path(TOP)).unwrap();
    let error = dataset.frame(12, 1).unwrap_err().to_string();
    assert!(error.starts_with("episode 2 frame 2, camera "), "{error}");
}

#[track_caller]
fn change_ends(copy: &Copy, change: impl Fn(f64) -> f64) {
    copy.edit_table(EPISODES, |rows| {
        let ends = rows.column_by_name(TOP_TO).unwrap();
        let ends = ends.as_primitive::<Float64Type>().values();
        let ends: Float64Array = ends.iter().map(|end| Some(change(*end))).collect();
        vec![with_column(rows, TOP_TO, Arc::new(ends))]
    });
}

fn without_ends(rows: RecordBatch) -> Vec<RecordBatch> {
    let kept = (0..rows.num_columns()).filter(|i| rows.schema().field(*i).name() != TOP_TO);
    vec![rows.project(&kept.collect::<Vec<_>>()).unwrap()]
}

/// LeRobot 0.6.1 does not read `to_timestamp`.
#[test]
fn ends_that_other_writers_give_leave_no_episode_out() {
    // The time of the last picture, and what no end can be.
    let changes: [fn(f64) -> f64; 3] = [|end| end - 1.0 / 30.0, |_| f64::NAN, |_| -1.0];
    for change in changes {
        let copy = Copy::default();
        change_ends(&copy, change);
        assert!(copy.open().unwrap().left_out().is_empty());
    }
    let copy = Copy::default();
    copy.edit_table(EPISODES, |rows| {
        let ends: Float64Array = (0..rows.num_rows()).map(|_| None).collect();
        vec![with_column(rows, TOP_TO, Arc::new(ends))]
    });
    assert!(copy.open().unwrap().left_out().is_empty());
    let copy = Copy::default();
    copy.edit_table(EPISODES, without_ends);
    assert!(copy.open().unwrap().left_out().is_empty());
    // Recordings that are made for tests show the same pictures again and again.
    copy.edit_table(EPISODES, |rows| {
        let begin = TOP_TO.replace("to_timestamp", "from_timestamp");
        let zeros = Float64Array::from(vec![0.0; rows.num_rows()]);
        vec![with_column(rows, &begin, Arc::new(zeros))]
    });
    let dataset = copy.open().unwrap();
    assert!(dataset.left_out().is_empty() && dataset.repairs().is_empty());
    // Where it is not there, the next episode's begin shows that pictures are missing.
    let copy = Copy::of(DROPPED);
    copy.edit_table(EPISODES, without_ends);
    assert_eq!(left_out(&copy.open().unwrap()), [(1, 17, 20)]);
}

#[test]
fn pictures_of_an_episode_that_the_metadata_lost_do_not_fill_one_that_is_short() {
    // The last episode's metadata and rows are not there, its pictures are.
    let copy = Copy::of(DROPPED);
    copy.edit_table(EPISODES, |rows| vec![rows.slice(0, 2)]);
    copy.edit_rows(|rows| rows.slice(0, 30));
    copy.edit_text(INFO, "\"total_frames\": 38", "\"total_frames\": 30");
    copy.edit_text(INFO, "\"total_episodes\": 3", "\"total_episodes\": 2");
    assert_eq!(left_out(&copy.open().unwrap()), [(1, 17, 20)]);
}

#[test]
fn a_file_that_ends_early_leaves_out_what_is_not_whole() {
    let copy = Copy::default();
    let short = recording("so100_sorting").join(TOP.replace("file-000", "file-001"));
    copy.edit(TOP, |_| fs::read(short).unwrap());
    let dataset = copy.open().unwrap();
    let rows = |n: usize| open("so100_pickplace").episodes()[n].frames.len();
    // The file has 75 pictures, and the first episode takes 41.
    let missing = [
        (1, 34, rows(1)),
        (2, 0, rows(2)),
        (3, 0, rows(3)),
        (4, 0, rows(4)),
        (5, 0, rows(5)),
    ];
    assert_eq!(left_out(&dataset), missing);
    assert_eq!((dataset.len(), recorded(&dataset)), (41, vec![0]));

    let copy = Copy::default();
    let shorter = "videos_and_rows/merged_in_few_files/videos/observation.images.wrist/chunk-000/file-001.mp4";
    copy.edit(TOP, |_| fs::read(fixtures().join(shorter)).unwrap());
    let error = copy.error().to_string();
    assert!(
        error.contains("no episode has a picture for every row"),
        "{error}"
    );
    assert!(error.contains("17 pictures for its 41 rows"), "{error}");
}

#[test]
fn videos_of_v21_are_compared_with_their_rows_too() {
    let video = |episode: usize| format!("videos/chunk-000/{WRIST}/episode_00000{episode}.mp4");
    let copy = Copy::of("so100_pickplace_v21");
    // The first episode has 41 rows, the second 38.
    let (long, short) = (copy.path(&video(0)), copy.path(&video(1)));
    let (pictures_of_0, pictures_of_1) = (fs::read(&long).unwrap(), fs::read(&short).unwrap());
    fs::write(&long, pictures_of_1).unwrap();
    let dataset = copy.open().unwrap();
    assert_eq!(left_out(&dataset), [(0, 38, 41)]);
    assert_eq!(recorded(&dataset), [1, 2, 3, 4, 5]);
    fs::write(&long, &pictures_of_0).unwrap();
    fs::write(&short, &pictures_of_0).unwrap();
    let dataset = copy.open().unwrap();
    assert!(dataset.left_out().is_empty());
    let note = dataset.repairs()[0].to_string();
    assert!(
        note.contains("episode 1, 41 pictures for 38 rows"),
        "{note}"
    );
}

/// The merges' metadata also names data files that were never written: LeRobot 0.6.1 reads the rows by their numbers.
#[test]
fn rows_are_found_whatever_their_files_are_called() {
    let whole = open("so100_sorting");
    let copy = Copy::of("so100_sorting");
    let file = |name: &str| copy.path(&format!("data/chunk-000/{name}.parquet"));
    fs::rename(file("file-002"), file("file-007")).unwrap();
    fs::write(file("._file-000"), b"left by a file manager").unwrap();
    let dataset = copy.open().unwrap();
    for frame in 0..whole.len() {
        assert_eq!(dataset.state(frame), whole.state(frame));
    }
    // LeRobot 0.6.1 has names for the files where the metadata has none.
    copy.edit(INFO, |bytes| {
        let mut info: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
        for name in ["data_path", "video_path"] {
            info.as_object_mut().unwrap().remove(name).unwrap();
        }
        serde_json::to_vec(&info).unwrap()
    });
    let unnamed = copy.open().unwrap();
    assert!(unnamed.frame(240, 1).unwrap() == whole.frame(240, 1).unwrap());
    // What is not there at all is named.
    fs::remove_file(file("file-007")).unwrap();
    let missing = copy.error();
    assert!(
        matches!(&missing, DatasetError::MissingFile { path } if *path == file("file-002")),
        "{missing}"
    );
    fs::remove_file(file("file-000")).unwrap();
    let missing = copy.error();
    assert!(
        matches!(&missing, DatasetError::MissingFile { path } if *path == copy.path(DATA)),
        "{missing}"
    );
}

#[test]
fn statistics_of_v21_without_a_count_are_those_of_the_episodes_length() {
    let whole = open("so100_pickplace_v21");
    // LeRobot writes a list of one number. The number alone states the same.
    for keep in [false, true] {
        let copy = Copy::of("so100_pickplace_v21");
        copy.edit("meta/episodes_stats.jsonl", |bytes| {
            let lines = String::from_utf8(bytes).unwrap();
            let lines = lines.lines().map(|line| {
                let mut line: serde_json::Value = serde_json::from_str(line).unwrap();
                for feature in ["action", "observation.state"] {
                    let stats = line["stats"][feature].as_object_mut().unwrap();
                    let count = stats.remove("count").unwrap()[0].clone();
                    if keep {
                        stats.insert("count".into(), count);
                    }
                }
                format!("{line}\n")
            });
            lines.collect::<String>().into_bytes()
        });
        assert_eq!(copy.open().unwrap().stats(), whole.stats());
    }
}
