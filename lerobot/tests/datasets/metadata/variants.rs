//! Metadata in other words than LeRobot's: what states the same is read, and what LeRobot 0.6.1 reads wrongly is refused or read right.
//! `tests/fixtures/metadata/make.py` made the variants of `so100_sorting_two`, and noted what LeRobot makes of each.

use std::collections::BTreeSet;
use std::fs;

use serde_json::Value;
use zk0_lerobot::dataset::{Dataset, Frame};
use zk0_testkit::recordings::{fixtures, open, Copy};

const BASE: &str = "so100_sorting_two";

/// LeRobot gives the frames of the base, although the files contradict each other; here they are refused.
const CONTRADICTIONS: [(&str, &str); 4] = [
    (
        "fps_of_a_fraction",
        "29.97 where a whole number is expected",
    ),
    ("episodes_other_length", "found episode 0 of 44 frames"),
    (
        "episodes_other_bounds",
        "found episode 1 of 45 frames, 0..90",
    ),
    (
        "episodes_numbered_from_1",
        "expected episode 0 of 2 from frame 0 on, found episode 1",
    ),
];

/// LeRobot fails, gives other frames, or trains without statistics.
const REFUSED: [(&str, &str); 17] = [
    ("totals_as_text", "expected a JSON number"),
    ("without_total_frames", "missing field `total_frames`"),
    ("without_total_episodes", "missing field `total_episodes`"),
    ("more_frames", "declares 2 with 91"),
    ("fewer_frames", "end at frame 89"),
    ("more_episodes", "declares 3 with 90"),
    ("without_stats_file", "stats.json: missing"),
    ("without_stats_of_action", "no statistics of action"),
    ("stats_of_one_number", "1 means and 1 standard deviations"),
    ("stats_as_text", "where numbers are expected"),
    ("tasks_with_a_gap", "task_index 2 and no task_index 1"),
    ("episodes_backwards", WRONG_FRAMES),
    ("episodes_in_files_backwards", WRONG_FRAMES),
    (
        "episodes_without_dataset_from_index",
        "no column \"dataset_from_index\"",
    ),
    (
        "episodes_without_dataset_to_index",
        "no column \"dataset_to_index\"",
    ),
    (
        "episodes_without_videos_observation.images.top_chunk_index",
        "no column",
    ),
    (
        "episodes_without_videos_observation.images.top_from_timestamp",
        "no column",
    ),
];
const WRONG_FRAMES: &str = "gives wrong frames here: write it sorted by episode_index";

/// LeRobot fails, or gives other tasks: it takes the n-th row of the table for task n.
const READ: [&str; 5] = [
    "totals_float",
    "without_total_tasks",
    "null_video_path",
    "null_chunks_size",
    "tasks_backwards",
];

/// Other statistics, in LeRobot as here.
const OTHER_STATISTICS: [&str; 2] = ["stats_whole_numbers", "stats_within_a_list"];

fn variants() -> Vec<Value> {
    let text = fs::read(fixtures().join("metadata/variants.json")).unwrap();
    serde_json::from_slice(&text).unwrap()
}

/// The base with the changes of a variant.
fn copy(variant: &Value, name: &str) -> Copy {
    let copy = Copy::of(BASE);
    let tables = fixtures().join("metadata").join(name);
    if tables.is_dir() {
        copy.add(&tables);
    }
    for change in variant["values"].as_array().unwrap() {
        let change = change.as_array().unwrap();
        let (file, path) = (change[0].as_str().unwrap(), change[1].as_array().unwrap());
        let Some((last, above)) = path.split_last() else {
            fs::remove_file(copy.path(file)).unwrap();
            continue;
        };
        copy.edit(file, |bytes| {
            let mut all: Value = serde_json::from_slice(&bytes).unwrap();
            let mut place = &mut all;
            for key in above {
                place = &mut place[key.as_str().unwrap()];
            }
            let place = place.as_object_mut().unwrap();
            let key = last.as_str().unwrap();
            match change.get(2) {
                Some(value) => drop(place.insert(key.into(), value.clone())),
                None => drop(place.remove(key).unwrap()),
            }
            serde_json::to_vec(&all).unwrap()
        });
    }
    copy
}

/// All frames, and pictures of both episodes.
fn content(dataset: &Dataset) -> Vec<Frame> {
    let mut loader = dataset.loader(3).unwrap();
    let motion: Vec<Frame> = (0..dataset.len())
        .map(|frame| loader.motion(frame).unwrap())
        .collect();
    let pictures = [0, 44, 45, 89].map(|frame| loader.frame(frame).unwrap());
    motion.into_iter().chain(pictures).collect()
}

#[test]
fn what_says_the_same_is_read_and_what_does_not_is_refused() {
    let base = open(BASE);
    let wanted = content(&base);
    let mut seen = BTreeSet::new();
    for variant in variants() {
        let name = variant["name"].as_str().unwrap();
        let same = variant["lerobot"] == "the same";
        let listed = |list: &[(&str, &'static str)]| {
            let found = list.iter().find(|(of, _)| *of == name);
            found.map(|(_, cause)| *cause)
        };
        let (contradiction, refusal) = (listed(&CONTRADICTIONS), listed(&REFUSED));
        let read = READ.contains(&name) || OTHER_STATISTICS.contains(&name);
        assert_eq!(
            same,
            refusal.is_none() && !read,
            "{name} in LeRobot: {}",
            variant["lerobot"]
        );
        seen.insert(name.to_owned());
        let copy = copy(&variant, name);
        match contradiction.or(refusal) {
            Some(cause) => {
                let error = copy.error().to_string();
                assert!(error.contains(cause), "{name}: {error}");
            }
            None => {
                let dataset = copy.open().unwrap_or_else(|e| panic!("{name}: {e}"));
                assert!(content(&dataset) == wanted, "{name}");
                assert!(dataset.repairs().is_empty(), "{name}");
                if name == "stats_whole_numbers" {
                    let action = &dataset.stats().action;
                    assert_eq!(action.mean(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
                    assert_eq!(action.std(), [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]);
                } else {
                    assert_eq!(dataset.stats(), base.stats(), "{name}");
                }
            }
        }
    }
    let all = CONTRADICTIONS.iter().chain(&REFUSED).map(|(name, _)| name);
    for name in all.chain(&READ).chain(&OTHER_STATISTICS) {
        assert!(seen.contains(*name), "{name} is no variant");
    }
    assert!(seen.len() > 60);
}
