//! Recordings that are written anew because their videos and metadata do not fit (see the fixtures' README, "videos_and_rows").
//! `tests/fixtures/videos_and_rows/check.py` loads the results in LeRobot 0.6.1.

use std::fs;
use std::path::Path;

use tempfile::TempDir;
use zk0_lerobot::dataset::{recover, Dataset, DatasetError, Recovered};
use zk0_testkit::recordings::{open, recording, Copy};

use crate::datasets::picture_digests::{self, expected};

const MANY_FILES: &str = "../videos_and_rows/merged_in_many_files";

/// Digests of our pictures as the metadata states, with nothing put right.
fn pictures(dataset: &Dataset) -> Vec<[String; 2]> {
    assert!(dataset.repairs().is_empty() && dataset.left_out().is_empty());
    picture_digests::pictures(dataset)
}

fn saved(from: &Path) -> (TempDir, Recovered, Dataset) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("saved");
    let report = recover(from, &out).unwrap();
    let dataset = Dataset::open(out).unwrap();
    (folder, report, dataset)
}

fn causes(report: &Recovered) -> Vec<String> {
    report.lost.iter().map(ToString::to_string).collect()
}

#[test]
fn merges_are_written_with_the_right_places_of_their_videos() {
    for (name, notes) in [
        ("../videos_and_rows/merged_in_few_files", 1),
        (MANY_FILES, 2),
    ] {
        let (_folder, report, dataset) = saved(&recording(name));
        assert!(pictures(&dataset) == expected("merged"), "{name}");
        let before = open(name);
        assert_eq!(dataset.len(), before.len());
        for frame in 0..before.len() {
            assert_eq!(dataset.state(frame), before.state(frame));
            assert_eq!(dataset.action(frame), before.action(frame));
        }
        assert_eq!((report.saved.len(), report.lost.len()), (5, 0));
        assert_eq!(report.notes.len(), notes);
        assert!(report.notes[0].contains("as merges by LeRobot 0.4.0 to 0.4.2 do"));
    }
}

#[test]
fn an_episode_with_dropped_pictures_is_not_written() {
    let (_folder, report, dataset) = saved(&recording("../videos_and_rows/dropped_pictures"));
    let right = expected("dropped_pictures");
    assert!(pictures(&dataset) == [&right[..10], &right[30..]].concat());
    let lost = "episode 1: observation.images.top has 17 pictures for its 20 rows, and nothing tells which are missing";
    assert_eq!(causes(&report), [lost]);
    let recorded: Vec<u64> = report.saved.iter().map(|e| e.recorded_as).collect();
    assert_eq!(recorded, [0, 2]);
}

#[test]
fn a_merge_whose_files_are_not_filled_keeps_the_episodes_before() {
    // Ten pictures in place of seven, and seven in place of twenty.
    for (from, to, kept, rows) in [(2, 3, 4, 51), (3, 1, 2, 21)] {
        let copy = Copy::of(MANY_FILES);
        let file = |n| {
            let name = format!("videos/observation.images.top/chunk-000/file-00{n}.mp4");
            copy.path(&name)
        };
        fs::copy(file(from), file(to)).unwrap();
        assert!(matches!(copy.error(), DatasetError::SharedPictures { .. }));
        let (_folder, report, dataset) = saved(copy.root());
        assert!(pictures(&dataset) == expected("merged")[..rows]);
        assert_eq!(dataset.episodes().len(), kept);
        let causes = causes(&report);
        assert_eq!(causes.len(), 5 - kept);
        let cause = format!("file-00{to}.mp4 has ");
        assert!(causes.iter().all(|c| c.contains(&cause)), "{causes:?}");
        assert!(causes[0].starts_with(&format!("episode {kept}: ")));
    }
}

/// Rows that are there twice are written once.
#[test]
fn copies_of_rows_are_not_written() {
    let (_folder, report, dataset) = saved(&recording("so100_stacking_doubled"));
    assert!(dataset.repairs().is_empty());
    assert_eq!((dataset.len(), report.lost.len()), (249, 0));
    assert!(report.notes[0].contains("249 rows repeat frames"));
}
