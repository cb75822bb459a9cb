//! `zk0 compare`: what it measures and states, that interruptions and threads change nothing, and what it refuses.

mod refused;
mod results;
mod search;

use crate::harness::{ends, fails, logged, prints, text, zk0};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const DATASETS: [&str; 2] = [
    "tests/fixtures/datasets/so100_pickplace",
    "tests/fixtures/datasets/so100_stacking",
];
const UNSEEN: &str = "tests/fixtures/datasets/so100_sorting_two";

/// What is fast to compare.
const SMALL: [&str; 8] = [
    "--rounds",
    "3",
    "--steps",
    "4",
    "--batch-size",
    "4",
    "--eval-frames",
    "6",
];

/// The command that compares on these recordings, with results in `out`.
fn compare<'a>(out: &'a Path, more: &[&'a str]) -> Vec<&'a str> {
    let datasets = DATASETS.iter().flat_map(|dataset| ["--dataset", dataset]);
    let command = ["compare", "--no-cache", "--out", text(out)];
    let command = command.into_iter().chain(datasets);
    command.chain(more.iter().copied()).collect()
}

/// Compares with small options.
#[track_caller]
fn small(out: &Path, more: &[&str]) -> String {
    let seeds = match more.contains(&"--seeds") {
        true => &[][..],
        false => &["--seeds", "2"],
    };
    prints(&compare(out, &[&SMALL[..], seeds, more].concat()))
}

/// `comparison.json`.
fn comparison(out: &Path) -> Value {
    let file = fs::read(out.join("comparison.json")).unwrap();
    serde_json::from_slice(&file).unwrap()
}

/// All files below a folder by name.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if path.is_dir() {
            let below = files(&path).into_iter();
            all.extend(below.map(|(below, file)| (format!("{name}/{below}"), file)));
        } else {
            all.insert(name, fs::read(path).unwrap());
        }
    }
    all
}

#[track_caller]
fn assert_same(one: &Path, other: &Path) {
    let (one, other) = (files(one), files(other));
    assert_eq!(
        one.keys().collect::<Vec<_>>(),
        other.keys().collect::<Vec<_>>()
    );
    for (name, file) in &one {
        assert!(*file == other[name], "{name} differs");
    }
}

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}
