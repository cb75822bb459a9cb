//! Episodes that are there twice.

use zk0_lerobot::dataset::CopiedEpisodes;
use zk0_testkit::recordings::{open, recording};

/// LeRobot 0.6.1 merged a recording with itself: see the fixtures' README, "videos_and_rows".
#[test]
fn a_merge_of_two_copies_has_every_episode_twice() {
    let merged = open("../videos_and_rows/merged_with_itself");
    let root = merged.root().to_path_buf();
    let copied = CopiedEpisodes::among([&merged]);
    let expected = CopiedEpisodes {
        recording: root.clone(),
        of: root,
        within_one: true,
        episodes: vec![2, 3],
        first: (2, 0),
    };
    assert_eq!(copied, [expected]);
    let note = copied[0].to_string();
    let states = "merged_with_itself: 2 of its episodes are copies: episode 2 has the states and actions of episode 0.";
    assert!(note.contains(states), "{note}");
    assert!(
        note.contains("--operation.episode_indices '[2, 3]'"),
        "{note}"
    );
}

#[test]
fn copies_in_another_recording_are_found_by_their_content() {
    let names = ["so100_sorting", "so101_pickplace", "so100_sorting_two"];
    let recordings = names.map(open);
    let copied = CopiedEpisodes::among(&recordings);
    let expected = CopiedEpisodes {
        recording: recording("so100_sorting_two"),
        of: recording("so100_sorting"),
        within_one: false,
        episodes: vec![0, 1],
        first: (0, 4),
    };
    assert_eq!(copied, [expected]);
    // A recording that is given twice is two.
    let twice = ["so100_sorting", "so100_sorting"].map(open);
    assert!(!CopiedEpisodes::among(&twice)[0].within_one);
    // The videos are encoded anew there, the motion is the same.
    let again = ["so100_pickplace", "so100_pickplace_v21"].map(open);
    assert_eq!(CopiedEpisodes::among(&again)[0].episodes.len(), 6);
    let others = ["so100_pickplace", "so100_stacking", "so101_pickplace"].map(open);
    assert_eq!(CopiedEpisodes::among(&others), []);
}
