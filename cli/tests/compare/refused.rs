//! What cannot be compared.

use super::{compare, ends, fails, folder, logged, small, text, zk0, DATASETS, SMALL};
use zk0_testkit::recordings::{Copy, INFO};

#[track_caller]
fn refused(more: &[&str], why: &str) {
    let out = folder();
    let reported = fails(&compare(out.path(), &[&SMALL, more].concat()));
    assert!(reported.contains(why), "{reported}");
}

#[test]
fn options_that_make_no_sense_are_named() {
    refused(
        &["--eval-episodes", "0"],
        "--eval-episodes is 0; a comparison needs held-out episodes",
    );
    refused(
        &["--search", "--search-factor", "0.5"],
        "--search-factor is 0.5; it has to be from 1 to 1000000",
    );
    refused(
        &["--search-minutes", "0"],
        "--search-minutes is 0; it has to be above 0",
    );
    refused(&["--search-mu=-1"], "mu of FedProx is -1");
    refused(
        &["--strategy", r#"{"trimmed-mean": {"trim_bps": 5000}}"#],
        "rule strategy leaves out 5000 basis points",
    );
    refused(
        &["--learning-rate", "0", "--threads", "1"],
        "training with seed 0, federated: round 0, node-1: the policy:",
    );
    for (option, value, why) in [
        ("--seeds", "1", "1 is not in 2..=1000"),
        ("--same-steps", "some", "this is total or node"),
        ("--search-strategy", "best", "a strategy is fed-avg, median"),
    ] {
        let out = folder();
        let command = zk0(&compare(out.path(), &[option, value]));
        let reported = logged(&ends(2, command));
        assert!(reported.contains(why), "{reported}");
    }
}

#[test]
fn recordings_that_cannot_be_compared_are_named() {
    refused(&["--dataset", "nowhere"], "error: nowhere: no such folder");
    // The same recording twice, and one that holds episodes of another.
    refused(
        &["--unseen", DATASETS[0]],
        "episode 0 of so100_pickplace is the same as episode 0 of so100_pickplace",
    );
    let sorting = ["so100_sorting", "so100_sorting_two"];
    let sorting = sorting.map(|name| format!("tests/fixtures/datasets/{name}"));
    refused(
        &["--dataset", &sorting[0], "--unseen", &sorting[1]],
        "of so100_sorting_two is the same as episode",
    );
    let other = Copy::default();
    other.edit_text(INFO, "\"main_gripper\"", "\"gripper.pos\"");
    refused(
        &["--unseen", text(other.root())],
        "\"gripper.pos\"], not [\"main_",
    );
    // Two episodes for each of six nodes: one to train on, one to measure on, and none for a search.
    refused(
        &["--search", "--nodes", "6"],
        "node-1 has 2 episodes of so100_pickplace, so100_stacking, and needs 3 episodes: one to set aside",
    );
    refused(
        &["--nodes", "1"],
        "a federation of one node has nobody to be compared with",
    );
}

/// This policy takes states of 5 dimensions and actions of 4.
#[test]
fn a_recording_that_does_not_fit_the_policy_is_named() {
    refused(
        &["--policy", "tests/fixtures/smolvla_odd"],
        "recording tests/fixtures/datasets/so100_pickplace: ",
    );
    refused(
        &["--policy", "tests/fixtures/smolvla_odd"],
        "42 action values and 7 padding flags, the policy takes 7 frames of 4 dimensions",
    );
}

#[test]
fn a_folder_holds_one_comparison() {
    let out = folder();
    small(out.path(), &[]);
    let again = |more: &[&str]| fails(&compare(out.path(), &[&SMALL, more].concat()));
    let reported = again(&[]);
    let holds = format!("{} holds a comparison: add --resume", text(out.path()));
    assert!(reported.contains(&holds), "{reported}");
    for other in [
        ["--seed", "1"],
        ["--learning-rate", "0.1"],
        ["--same-steps", "node"],
        ["--search-trials", "2"],
        ["--unseen", super::UNSEEN],
    ] {
        let search = match other[0] {
            "--search-trials" => &["--search"][..],
            _ => &[],
        };
        let reported = again(&[&["--resume"][..], search, &other].concat());
        let why = "is a comparison with another policy, other recordings or other options";
        assert!(reported.contains(why), "{reported}");
    }
}
