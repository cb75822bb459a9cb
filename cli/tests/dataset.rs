//! `zk0 dataset inspect` and `zk0 dataset validate`, as a person or a script meets them.

use crate::harness::{self, copy, logged, printed};
use std::fs;
use std::process::{Command, Output};

fn zk0(arguments: &[&str]) -> Command {
    let mut command = harness::zk0(arguments);
    command
        .current_dir(harness::root().join("tests/fixtures/datasets"))
        .env_remove("HF_TOKEN");
    command
}

fn reported(output: &Output) -> String {
    printed(output) + &logged(output)
}

#[test]
fn inspect_shows_what_a_recording_holds() {
    let shown = zk0(&["dataset", "inspect", "so100_pickplace_v21"])
        .output()
        .unwrap();
    let text = reported(&shown);
    assert!(shown.status.success(), "{text}");
    for line in [
        "format     LeRobotDataset v2.1",
        "robot      so100",
        "episodes   6 of 38 to 44 frames",
        "frames     245 at 30 frames per second: 8.2 s",
        "cameras    observation.images.top    96 x 128 (height x width), AV1, a key frame every 2.0 frames",
        "           observation.images.wrist  96 x 128",
        "unit       degrees: main_shoulder_lift reaches -148.",
        "tasks      245 frames: Pick up the red cube and place it on the blue plate.",
        "repairs    none needed",
        "main_gripper           36.656     32.957      5.714     78.571",
        "observation.images.top    uint8   [3, 96, 128] ",
        "action_is_pad             bool    [50]            0.00 to 1.00",
    ] {
        assert!(text.contains(line), "{line:?} is not in\n{text}");
    }

    let shown = zk0(&[
        "dataset",
        "inspect",
        "so100_sorting",
        "--json",
        "--chunk",
        "7",
    ])
    .output()
    .unwrap();
    let json: serde_json::Value = serde_json::from_slice(&shown.stdout).unwrap();
    assert_eq!(json["format"], "v3.0");
    assert_eq!(json["tasks"].as_array().unwrap().len(), 2);
    assert_eq!(
        json["sample"]["tensors"][3]["shape"],
        serde_json::json!([7, 6])
    );
    assert_eq!(json["cameras"][1]["codec"], "AV1");
}

#[test]
fn inspect_says_what_it_put_right() {
    let shown = zk0(&["dataset", "inspect", "so100_stacking_doubled"])
        .output()
        .unwrap();
    assert!(shown.status.success());
    let note = "so100_stacking_doubled/data/chunk-000/file-000.parquet: 249 rows repeat frames that are there already";
    let table = String::from_utf8(shown.stdout).unwrap();
    assert!(table.contains(&format!("REPAIRED   {note}")), "{table}");
    // The log warns about the repair, too.
    let log = String::from_utf8(shown.stderr).unwrap();
    assert!(log.contains("WARN") && log.contains(note), "{log}");
}

#[test]
fn validate_lists_every_fault_and_says_so_by_its_exit_code() {
    let good = zk0(&[
        "dataset",
        "validate",
        "so100_pickplace",
        "so100_stacking_doubled",
    ])
    .output()
    .unwrap();
    let text = String::from_utf8(good.stdout).unwrap();
    assert_eq!(good.status.code(), Some(0), "{text}");
    assert!(
        text.contains("ok       so100_pickplace: 6 episodes, 245 frames, 490 pictures\n"),
        "{text}"
    );
    assert!(
        text.contains("  repaired so100_stacking_doubled/data/"),
        "{text}"
    );

    let bad = zk0(&[
        "dataset",
        "validate",
        "so100_pickplace_bad_timestamps",
        "so101_pickplace",
        "nowhere",
    ])
    .output()
    .unwrap();
    let text = String::from_utf8(bad.stdout).unwrap();
    assert_eq!(bad.status.code(), Some(1), "{text}");
    assert!(
        text.contains("FAULTY   so100_pickplace_bad_timestamps\n  fault    "),
        "{text}"
    );
    assert!(
        text.contains("file-000.parquet: episode 2 frame 10 has timestamp"),
        "{text}"
    );
    assert!(text.contains("ok       so101_pickplace"), "{text}");
    assert!(text.contains("nowhere: no such folder"), "{text}");
}

#[test]
fn validate_finds_every_video_that_does_not_decode() {
    let dir = tempfile::tempdir().unwrap();
    let fixture = harness::root().join("tests/fixtures/datasets/so100_pickplace_v21");
    copy(&fixture, dir.path());
    let video = |camera: &str, episode: u32| {
        dir.path().join(format!(
            "videos/chunk-000/observation.images.{camera}/episode_{episode:06}.mp4"
        ))
    };
    let whole = fs::read(video("top", 1)).unwrap();
    fs::write(video("top", 1), &whole[..whole.len() / 2]).unwrap();
    // The file has 38 pictures where the episode has more rows.
    fs::copy(video("wrist", 1), video("wrist", 4)).unwrap();
    let root = dir.path().to_str().unwrap();
    let bad = zk0(&["dataset", "validate", root]).output().unwrap();
    let text = String::from_utf8(bad.stdout).unwrap();
    assert_eq!(bad.status.code(), Some(1));
    assert_eq!(text.matches("  fault    ").count(), 2, "{text}");
    assert!(
        text.contains("fault    episode 1 frame 0, camera observation.images.top: "),
        "{text}"
    );
    assert!(
        text.contains(
            "episode 4 is left out: camera observation.images.wrist has 38 pictures for its "
        ),
        "{text}"
    );
}

#[test]
fn a_hub_that_cannot_be_reached_is_said_so() {
    let home = tempfile::tempdir().unwrap();
    let failed = zk0(&["dataset", "inspect", "hub:robots/so100"])
        .env("HF_ENDPOINT", "http://127.0.0.1:1")
        .env("HF_HOME", home.path())
        .output()
        .unwrap();
    let text = reported(&failed);
    assert_eq!(failed.status.code(), Some(1), "{text}");
    assert!(
        text.contains("robots/so100@main: http://127.0.0.1:1 cannot be asked"),
        "{text}"
    );
    let failed = zk0(&["dataset", "validate", "hub:so100"]).output().unwrap();
    assert!(reported(&failed).contains("write owner/name or owner/name@revision"));
    assert_eq!(failed.status.code(), Some(1));
}

#[test]
fn episodes_that_are_not_whole_or_there_twice_are_named() {
    let dropped = "../videos_and_rows/dropped_pictures";
    let left_out =
        "episode 1 is left out: camera observation.images.top has 17 pictures for its 20 rows";
    let twice = "../videos_and_rows/merged_with_itself";
    let bad = zk0(&["dataset", "validate", dropped, twice])
        .output()
        .unwrap();
    let text = printed(&bad);
    assert_eq!(bad.status.code(), Some(1), "{text}");
    for line in [
        &format!("FAULTY   {dropped}: 2 episodes, 18 frames, 36 pictures\n")[..],
        left_out,
        &format!("FAULTY   {twice}: 4 episodes"),
        "2 of its episodes are copies: episode 2 has the states and actions of episode 0.",
    ] {
        assert!(text.contains(line), "{line:?} is not in\n{text}");
    }
    // What two recordings share is a fault of neither.
    let stacking = ["so100_stacking", "so100_stacking_doubled"];
    let good = zk0(&[&["dataset", "validate"], &stacking[..]].concat())
        .output()
        .unwrap();
    let text = printed(&good);
    assert_eq!(good.status.code(), Some(0), "{text}");
    let shared = "copies   so100_stacking_doubled: 6 of its episodes are copies: episode 0 has the states and actions of episode 0 of \
                  so100_stacking.";
    assert!(text.contains(shared), "{text}");

    let inspected = printed(&zk0(&["dataset", "inspect", dropped]).output().unwrap());
    assert!(
        inspected.contains("LEFT OUT   ") && inspected.contains(left_out),
        "{inspected}"
    );

    let out = tempfile::tempdir().unwrap();
    let out = out.path().to_str().unwrap();
    let refused = zk0(&["train", "--profile", "micro", "--steps", "1", "--out", out])
        .args(["--dataset", dropped, "--whole-recordings"])
        .output()
        .unwrap();
    let text = reported(&refused);
    assert!(!refused.status.success(), "{text}");
    assert!(
        text.contains(left_out) && text.contains("--whole-recordings"),
        "{text}"
    );
}

#[test]
fn statistics_of_other_rows_are_a_fault() {
    // This part of a recording has the statistics of the whole.
    let bad = zk0(&["dataset", "validate", "so100_sorting_two"])
        .output()
        .unwrap();
    let text = printed(&bad);
    assert_eq!(bad.status.code(), Some(1), "{text}");
    for line in [
        "  fault    so100_sorting_two/meta/stats.json: the count of observation.state is 249, and the rows have 90; ",
        "  fault    so100_sorting_two/meta/stats.json: the count of action is 249, and the rows have 90; ",
        "--root so100_sorting_two --new_root so100_sorting_two --operation.type recompute_stats --operation.overwrite true\n",
    ] {
        assert!(text.contains(line), "{line:?} is not in\n{text}");
    }
    assert_eq!(text.matches("  fault    ").count(), 2, "{text}");
}

#[test]
fn where_no_episode_was_finished_it_has_to_be_recorded_again() {
    let ended = "../unfinished_recordings/killed_in_first_episode";
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("saved");
    let out = out.to_str().unwrap();
    let recover = ["dataset", "recover", ended, "--out", out];
    for arguments in [&["dataset", "validate", ended][..], &recover] {
        let failed = zk0(arguments).output().unwrap();
        let text = reported(&failed);
        assert_eq!(failed.status.code(), Some(1), "{text}");
        let reports = format!("{ended}: no episode was finished before the recording ended");
        assert!(text.contains(&reports), "{text}");
        assert!(text.contains(": record again\n"), "{text}");
    }
}
