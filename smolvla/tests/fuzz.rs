//! Inputs that fuzzing found, read again; and the fuzzing itself, for as long as one likes:
//!
//! ```sh
//! FUZZ_TARGET=mp4 FUZZ_SECONDS=600 cargo test --release -p zk0-smolvla --test fuzz -- --ignored --nocapture
//! ```
//!
//! It adds to `tests/fixtures/fuzz/<target>` one small input per outcome that is not there yet, and fails on a panic or an
//! allocation out of proportion, whose inputs it leaves there as well.

mod allocations;
mod fuzzing;
mod mp4_writer;
mod recordings;

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use fuzzing::{explore, run, target, NAMES};
use recordings::fixtures;
use sha2::{Digest, Sha256};

/// Largest input that is kept.
const MAX_KEPT: usize = 64 << 10;

fn folder(name: &str) -> PathBuf {
    fixtures().join("fuzz").join(name)
}

/// Inputs of a target by file name.
fn corpus(name: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let Ok(entries) = fs::read_dir(folder(name)) else {
        return Vec::new();
    };
    let mut paths: Vec<PathBuf> = entries.map(|e| e.unwrap().path()).collect();
    paths.sort();
    paths
        .into_iter()
        .map(|path| (path.clone(), fs::read(path).unwrap()))
        .collect()
}

/// The one test of this file that always runs: allocations are counted for the whole process.
#[test]
fn inputs_found_by_fuzzing_neither_panic_nor_allocate_out_of_proportion() {
    // Panics of the parquet crate are caught, and not worth a line each.
    std::panic::set_hook(Box::new(|_| ()));
    let mut wrong = Vec::new();
    for name in NAMES {
        let mut target = target(name);
        let mut outcomes = BTreeSet::new();
        for (path, input) in corpus(name) {
            match run(&mut target, &input) {
                Ok(outcome) => drop(outcomes.insert(outcome)),
                Err(finding) => wrong.push(format!("{}: {finding}", path.display())),
            }
        }
        for seed in target.seeds.clone() {
            if run(&mut target, &seed) != Ok("read".into()) {
                wrong.push(format!("{name}: a seed is not read"));
            }
        }
        println!("{name}: {} outcomes", outcomes.len());
        if outcomes.len() < 3 {
            wrong.push(format!("{name}: the corpus leads to {outcomes:?} alone"));
        }
    }
    let _ = std::panic::take_hook();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
#[ignore = "runs for FUZZ_SECONDS and writes into tests/fixtures"]
fn fuzzing() {
    let var = |name: &str| std::env::var(name).unwrap_or_else(|_| panic!("set {name}"));
    let name = var("FUZZ_TARGET");
    let time = Duration::from_secs(var("FUZZ_SECONDS").parse().unwrap());
    let seed = std::env::var("FUZZ_SEED").map_or(1, |s| s.parse().unwrap());
    std::panic::set_hook(Box::new(|_| ()));
    let mut target = target(&name);
    let known: Vec<Vec<u8>> = corpus(&name).into_iter().map(|(_, input)| input).collect();
    let seen: BTreeSet<String> = known
        .iter()
        .filter_map(|input| run(&mut target, input).ok())
        .collect();
    let found = explore(&mut target, known, time, seed);
    let _ = std::panic::take_hook();

    fs::create_dir_all(folder(&name)).unwrap();
    let keep = |label: &str, input: &[u8]| {
        let hash = hex::encode(&Sha256::digest(input)[..6]);
        fs::write(folder(&name).join(format!("{label}{hash}")), input).unwrap();
    };
    let mut new = 0;
    for (outcome, input) in &found.outcomes {
        if outcome != "read" && !seen.contains(outcome) && input.len() <= MAX_KEPT {
            keep("", input);
            new += 1;
        }
    }
    found
        .findings
        .iter()
        .for_each(|(_, input)| keep("finding-", input));
    println!(
        "{name}: {} runs in {} s, {} outcomes ({new} new), {} findings",
        found.runs,
        time.as_secs(),
        found.outcomes.len(),
        found.findings.len()
    );
    let findings: BTreeSet<&String> = found.findings.iter().map(|(finding, _)| finding).collect();
    assert!(findings.is_empty(), "{findings:?}");
}
