//! Inputs that fuzzing found: kept in one folder for each target, read again by a test that always runs.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use sha2::{Digest, Sha256};

use super::{explore, run};
use crate::targets::{target, NAMES};

/// Largest input that is kept.
const MAX_KEPT: usize = 64 << 10;

/// Inputs of a target by file name.
fn corpus(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let Ok(entries) = fs::read_dir(folder) else {
        return Vec::new();
    };
    let mut paths: Vec<PathBuf> = entries.map(|e| e.unwrap().path()).collect();
    paths.sort();
    paths
        .into_iter()
        .map(|path| (path.clone(), fs::read(path).unwrap()))
        .collect()
}

/// Has every target read its seeds and the inputs in its folder in `root`. Fails on a panic or an allocation out of proportion;
/// allocations are counted for the whole process, so nothing else may run.
pub fn read_again(root: &Path) {
    // Panics of libraries are caught, and not worth a line each.
    std::panic::set_hook(Box::new(|_| ()));
    let mut wrong = Vec::new();
    for name in NAMES {
        let mut target = target(name);
        let mut outcomes = BTreeSet::new();
        for (path, input) in corpus(&root.join(name)) {
            match run(&mut target, &input) {
                Ok(outcome) => drop(outcomes.insert(outcome)),
                Err(finding) => wrong.push(format!("{}: {finding}", path.display())),
            }
        }
        for seed in target.seeds.clone() {
            let outcome = run(&mut target, &seed);
            if outcome != Ok("read".into()) {
                wrong.push(format!("{name}: a seed is not read: {outcome:?}"));
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

/// Fuzzes the target FUZZ_TARGET for FUZZ_SECONDS and adds what is new to its folder in `root`.
pub fn fuzz(root: &Path) {
    let var = |name: &str| std::env::var(name).unwrap_or_else(|_| panic!("set {name}"));
    let name = var("FUZZ_TARGET");
    let folder = root.join(&name);
    let time = Duration::from_secs(var("FUZZ_SECONDS").parse().unwrap());
    let seed = std::env::var("FUZZ_SEED").map_or(1, |s| s.parse().unwrap());
    std::panic::set_hook(Box::new(|_| ()));
    let mut target = target(&name);
    let known: Vec<Vec<u8>> = corpus(&folder)
        .into_iter()
        .map(|(_, input)| input)
        .collect();
    let seen: BTreeSet<String> = known
        .iter()
        .filter_map(|input| run(&mut target, input).ok())
        .collect();
    let found = explore(&mut target, known, time, seed);
    let _ = std::panic::take_hook();

    fs::create_dir_all(&folder).unwrap();
    let keep = |label: &str, input: &[u8]| {
        let hash = hex::encode(&Sha256::digest(input)[..6]);
        fs::write(folder.join(format!("{label}{hash}")), input).unwrap();
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
