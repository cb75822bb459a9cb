//! Metadata of v2.1, in lines of JSON.

use super::*;

const EPISODES: &str = "meta/episodes.jsonl";
const EPISODE_STATS: &str = "meta/episodes_stats.jsonl";
const TASKS: &str = "meta/tasks.jsonl";

#[test]
fn v21_files_that_are_not_there() {
    let files = [
        EPISODES,
        EPISODE_STATS,
        TASKS,
        "data/chunk-000/episode_000003.parquet",
        "videos/chunk-000/observation.images.wrist/episode_000005.mp4",
    ];
    for file in files {
        let copy = Copy::of("so100_pickplace_v21");
        fs::remove_file(copy.path(file)).unwrap();
        assert!(
            matches!(copy.open(), Err(DatasetError::MissingFile { path }) if path == copy.path(file)),
            "{file}"
        );
    }
}

#[test]
fn v21_lines_that_are_wrong() {
    // Each case gives the file, the text in it, the text that replaces it, and the error of the reader.
    let cases = [
        (
            EPISODES,
            "\"length\": 38",
            "\"length\": 39",
            "declares 6 with 245",
        ),
        (
            EPISODES,
            "\"length\": 38",
            "\"length\": 0",
            "line 2: episode 1 has 0 frames",
        ),
        (
            EPISODES,
            "\"length\": 38",
            "\"length\": 99999999999",
            "line 2: episode 1 has 99999999999",
        ),
        (
            EPISODES,
            "\"length\": 38",
            "\"length\": -1",
            "line 2 is not the JSON",
        ),
        (
            EPISODES,
            "\"episode_index\": 5",
            "\"episode_index\": 6",
            "line 6: episode 6 where",
        ),
        (
            EPISODES,
            "\"episode_index\": 4",
            "\"episode_index\": 3",
            "an earlier line states 38",
        ),
        (
            EPISODES,
            "{\"episode_index\": 0",
            "{\"index\": 0",
            "missing field `episode_index`",
        ),
        (
            TASKS,
            "\"task_index\": 0",
            "\"task_index\": 1",
            "has task_index 1 and no task_index 0",
        ),
        (
            TASKS,
            "{\"task_index\"",
            "{task_index",
            "line 1 is not the JSON",
        ),
        (
            EPISODE_STATS,
            "\"episode_index\": 5",
            "\"episode_index\": 9",
            "line 6: episode 9 where",
        ),
        (
            EPISODE_STATS,
            "\"episode_index\": 5",
            "\"episode_index\": 4",
            "statistics of 5 episodes",
        ),
        (
            EPISODE_STATS,
            "\"action\": {\"min\"",
            "\"motion\": {\"min\"",
            "line 1 is not the JSON it should be: missing field `action`",
        ),
        (
            EPISODE_STATS,
            "\"count\": [41]",
            "\"count\": [0]",
            "line 1: action: count is [0.0]",
        ),
        (
            EPISODE_STATS,
            "\"count\": [41]",
            "\"count\": []",
            "line 1: action: count is a list of 0 numbers",
        ),
    ];
    for (file, from, to, cause) in cases {
        let copy = Copy::of("so100_pickplace_v21");
        copy.edit_text(file, from, to);
        copy.fails(file, cause);
    }
    let changes: [(fn(&mut serde_json::Value), &str); 2] = [
        (
            |s| s["std"][1] = (-1.0).into(),
            "action: standard deviation 1 is -1; it has to be",
        ),
        (
            |s| s["mean"] = vec![1.0].into(),
            "action: 1 means and 6 standard deviations",
        ),
    ];
    for (change, cause) in changes {
        let copy = Copy::of("so100_pickplace_v21");
        copy.edit(EPISODE_STATS, |bytes| {
            let text = String::from_utf8(bytes).unwrap();
            let (first, rest) = text.split_once('\n').unwrap();
            let mut line: serde_json::Value = serde_json::from_str(first).unwrap();
            change(&mut line["stats"]["action"]);
            format!("{line}\n{rest}").into_bytes()
        });
        copy.fails(EPISODE_STATS, cause);
    }
    // The reader does not read a line without an end to its end.
    let copy = Copy::of("so100_pickplace_v21");
    copy.edit(EPISODES, |mut bytes| {
        bytes.extend(vec![b' '; 2 << 20]);
        bytes
    });
    copy.fails(EPISODES, "line 7 is longer than 1048576 bytes");
}

#[test]
fn v21_paths_stay_in_the_folder() {
    let path = "is not one that can be followed";
    for (from, to, cause) in [
        ("data/chunk-{", "../data/chunk-{", path),
        (
            "{episode_index:06d}.parquet",
            "{file_index:03d}.parquet",
            path,
        ),
        (
            "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
            "",
            path,
        ),
        (
            "\"video_path\"",
            "\"no_video_path\"",
            "has videos but no video_path",
        ),
        (
            "\"chunks_size\": 1000",
            "\"chunks_size\": 0",
            "chunks_size is 0",
        ),
    ] {
        let copy = Copy::of("so100_pickplace_v21");
        copy.edit_text(INFO, from, to);
        copy.fails(INFO, cause);
    }
}

#[test]
fn episodes_and_tasks_of_v21_are_complete_and_short() {
    let copy = Copy::of("so100_pickplace_v21");
    copy.edit(EPISODES, |bytes| {
        let text = String::from_utf8(bytes).unwrap();
        let lines = text.lines().enumerate().filter(|(number, _)| *number != 1);
        let lines: Vec<&str> = lines.map(|(_, line)| line).collect();
        lines.join("\n").into_bytes()
    });
    copy.fails(EPISODES, "has no line for episode 1");

    let copy = Copy::of("so100_pickplace_v21");
    copy.edit_text(INFO, "\"total_tasks\": 1", "\"total_tasks\": 17");
    let long = "x".repeat(1_000_000);
    let line = |index| format!("{{\"task_index\": {index}, \"task\": \"{long}\"}}\n");
    copy.edit(TASKS, |_| {
        (0..17).map(line).collect::<String>().into_bytes()
    });
    copy.fails(TASKS, "holds more than 16777216 bytes of task strings");
}
