//! Statistics that are not those of the rows are found, and those that LeRobot wrote for the rows are not.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{json, Value};
use zk0_lerobot::dataset::{Dataset, StatisticsFault};
use zk0_testkit::recordings::{fixtures, recording, Copy, STATS};

/// Parts of `so100_sorting` that got the statistics of the whole, as the fixtures' README states.
const PARTS: [&str; 2] = ["so100_sorting_two", "so100_sorting_four"];

fn faults(root: impl AsRef<Path>) -> Vec<StatisticsFault> {
    Dataset::open(root).unwrap().statistics_faults().unwrap()
}

/// All recordings of the fixtures that can be read.
fn readable() -> Vec<PathBuf> {
    let folders = |of: PathBuf| fs::read_dir(of).unwrap().map(|entry| entry.unwrap().path());
    let recordings = folders(fixtures()).filter(|kind| kind.is_dir());
    let recordings = recordings.flat_map(folders);
    recordings
        .filter(|root| root.join("meta/info.json").exists() && Dataset::open(root).is_ok())
        .collect()
}

#[test]
fn statistics_that_lerobot_wrote_for_the_rows_are_no_fault() {
    let (mut sound, mut parts) = (0, 0);
    for root in readable() {
        let found = faults(&root);
        if PARTS.iter().any(|part| root.ends_with(part)) {
            assert_eq!(found.len(), 2, "{}: {found:?}", root.display());
            parts += 1;
        } else {
            assert_eq!(found, [], "{}", root.display());
            sound += 1;
        }
    }
    assert_eq!((sound >= 12, parts), (true, PARTS.len()), "{sound}");
}

/// The statistics of a part of a recording are those of the whole: the count tells, and a value.
#[test]
fn statistics_of_other_rows_are_found() {
    let found = faults(recording("so100_sorting_two"));
    for (fault, feature) in found.iter().zip(["observation.state", "action"]) {
        assert_eq!((fault.feature, fault.statistic), (feature, "count"));
        assert_eq!((fault.written, fault.found), (249.0, 90.0));
        assert!(fault.differ > 6, "{fault:?}");
    }
    let root = recording("so100_sorting_two");
    let root = root.display();
    let reported = found[1].to_string();
    let begin =
        format!("{root}/meta/stats.json: the count of action is 249, and the rows have 90; ");
    assert!(reported.starts_with(&begin), "{reported}");
    let command = format!(
        "lerobot-edit-dataset --repo_id NAME --root {root} --new_root {root} --operation.type recompute_stats --operation.overwrite true"
    );
    assert!(reported.ends_with(&command), "{reported}");
}

/// Changes the statistics of the actions.
fn changed(change: impl FnOnce(&mut Value)) -> Vec<StatisticsFault> {
    let copy = Copy::default();
    copy.edit(STATS, |bytes| {
        let mut all: Value = serde_json::from_slice(&bytes).unwrap();
        change(&mut all["action"]);
        all.to_string().into_bytes()
    });
    faults(copy.root())
}

#[test]
fn each_statistic_is_compared_and_its_joint_named() {
    for statistic in ["min", "max", "mean", "std"] {
        let mut was = 0.0;
        let found = changed(|action| {
            let value = &mut action[statistic][5];
            was = value.as_f64().unwrap();
            *value = json!(was + 0.5);
        });
        let [fault] = &found[..] else {
            panic!("{statistic}: {found:?}")
        };
        assert_eq!(fault.statistic, statistic);
        assert_eq!((fault.feature, fault.differ), ("action", 1));
        assert_eq!(fault.joint.as_deref(), Some("main_gripper"));
        assert!((fault.written - was - 0.5).abs() < 1e-4, "{fault:?}");
        assert!((fault.found - was).abs() < 1e-4, "{fault:?}");
    }
    let found = changed(|action| action["count"] = json!([244]));
    assert_eq!(found[0].statistic, "count");
    assert_eq!(found[0].joint, None);
}

#[test]
fn what_is_not_stated_or_computed_otherwise_is_no_fault() {
    let found = changed(|action| {
        let action = action.as_object_mut().unwrap();
        action.retain(|name, _| name == "mean" || name == "std");
    });
    assert_eq!(found, []);
    // Some tools divide by one row less.
    let found = changed(|action| {
        for std in action["std"].as_array_mut().unwrap() {
            *std = json!(std.as_f64().unwrap() * (245f64 / 244.0).sqrt());
        }
    });
    assert_eq!(found, []);
}

/// In v2.1 the statistics of the episodes are pooled.
#[test]
fn an_episode_of_other_rows_is_found_in_v21() {
    let copy = Copy::of("so100_pickplace_v21");
    copy.edit("meta/episodes_stats.jsonl", |bytes| {
        let text = String::from_utf8(bytes).unwrap();
        let mut lines: Vec<Value> = text
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect();
        lines[2]["stats"]["action"]["max"][0] = json!(999.0);
        let lines = lines.iter().map(|line| format!("{line}\n"));
        lines.collect::<String>().into_bytes()
    });
    let found = faults(copy.root());
    let [fault] = &found[..] else {
        panic!("{found:?}")
    };
    assert_eq!((fault.statistic, fault.written), ("max", 999.0));
    let reported = fault.to_string();
    assert!(
        reported.contains("Convert the recording to v3.0"),
        "{reported}"
    );
}

/// A table with rows twice: LeRobot's `recompute_stats` counts both copies.
#[test]
fn the_count_of_doubled_rows_is_no_fault() {
    let copy = Copy::of("so100_stacking_doubled");
    copy.edit(STATS, |bytes| {
        let mut all: Value = serde_json::from_slice(&bytes).unwrap();
        for feature in ["observation.state", "action"] {
            all[feature]["count"] = json!([498]);
        }
        all.to_string().into_bytes()
    });
    assert_eq!(faults(copy.root()), []);
}
