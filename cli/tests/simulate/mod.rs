//! `zk0 simulate`: the same results whatever the number of threads and however often it is stopped, and those of a real network.

mod network;
mod results;

use crate::harness::{ends, fails, logged, prints, root, text, zk0};
use serde_json::Value;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const DATASETS: [&str; 2] = [
    "tests/fixtures/datasets/so100_pickplace",
    "tests/fixtures/datasets/so100_stacking",
];

/// What is fast to simulate.
const SMALL: [&str; 6] = ["--steps", "8", "--batch-size", "4", "--eval-frames", "8"];

/// The command that simulates these recordings, with results in `out`.
fn simulate<'a>(out: &'a Path, more: &[&'a str]) -> Vec<&'a str> {
    let datasets = DATASETS.iter().flat_map(|dataset| ["--dataset", dataset]);
    let command = ["simulate", "--no-cache", "--out", text(out)];
    let command = command.into_iter().chain(datasets);
    command.chain(more.iter().copied()).collect()
}

/// Simulates with small options.
#[track_caller]
fn small(out: &Path, more: &[&str]) -> String {
    prints(&simulate(out, &[&SMALL, more].concat()))
}

/// What a round came to.
fn round(out: &Path, number: u64) -> Value {
    let file = fs::read(out.join(format!("round_{number}.json"))).unwrap();
    serde_json::from_slice(&file).unwrap()
}

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}
