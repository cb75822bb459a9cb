//! Nodes: docs/join.md, docs/train.md and docs/prove.md, as far as they need no proof.

use super::Reader;
use crate::harness::{copy, root, RECORDING};
use std::fs;

/// A reader who has a recording of the fixtures.
fn with_recording(fixture: &str) -> Reader {
    let reader = Reader::new();
    copy(&root().join(fixture), &reader.path("my_recording"));
    reader
}

#[test]
fn a_node_makes_its_key_and_looks_at_its_recording_by_the_page() {
    let reader = with_recording(RECORDING);
    let page = "docs/join.md";
    let made = reader.follows(page, "zk0 node keygen node.key");
    assert_eq!(reader.follows(page, "zk0 node identity node.key"), made);
    for page in [page, "docs/train.md"] {
        let faults = reader.follows(page, "zk0 dataset validate my_recording");
        assert!(faults.contains("ok       my_recording"), "{faults}");
    }
    let inspected = reader.follows("docs/train.md", "zk0 dataset inspect my_recording");
    assert!(inspected.contains("245"), "{inspected}");
}

#[test]
fn a_recording_that_was_killed_is_recovered_by_the_page() {
    let reader = with_recording("tests/fixtures/unfinished_recordings/killed_in_batch");
    let page = "docs/train.md";
    reader.follows(page, "zk0 dataset recover my_recording");
    fs::remove_dir_all(reader.path("my_recording")).unwrap();
    fs::rename(reader.path("saved"), reader.path("my_recording")).unwrap();
    reader.follows(page, "zk0 dataset validate my_recording");
}

#[test]
fn a_claim_is_estimated_by_the_page() {
    let reader = with_recording(RECORDING);
    let estimate = reader.follows("docs/prove.md", "zk0 node estimate --dataset");
    assert!(
        estimate.contains("a claim over 16 samples of model micro"),
        "{estimate}"
    );
}
