//! Inputs that fuzzing found, a folder for each target.

use std::collections::BTreeSet;
use std::fs;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::path::{Path, PathBuf};

use super::{Target, Targets};
use crate::allocations;

/// An input's result: the error without particulars, or `read`. `Err` is a finding.
fn outcome(targets: &Targets, target: &mut Target, input: &[u8]) -> Result<String, String> {
    let read = catch_unwind(AssertUnwindSafe(|| targets.run(target, input)));
    Ok(match read.map_err(|_| "a panic")?? {
        Ok(()) => "read".into(),
        Err(message) => class(&message),
    })
}

/// The message up to a quotation, without words with digits, so that one fault is one outcome.
fn class(message: &str) -> String {
    let end = message.find(['"', '`', '\'']).unwrap_or(message.len());
    let words = message[..end].split(' ');
    let words: Vec<&str> = words
        .filter(|word| !word.contains(char::is_numeric))
        .collect();
    words.join(" ")
}

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

/// Reads each target's seeds and the inputs in `tests/corpus/<crate>/<target>`. Fails on a panic or an allocation out of proportion. Other
/// tests of the process must be [`allocations::alone`], too.
pub fn read_again(of: &str, targets: &Targets) {
    let _alone = allocations::alone();
    #[cfg(fuzzing)]
    if let Ok(name) = std::env::var("FUZZ_TARGET") {
        return super::guided::fuzz(targets, &name);
    }
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/corpus");
    let root = Path::new(root).join(of);
    // Libraries' panics are caught, and need no output.
    std::panic::set_hook(Box::new(|_| ()));
    let mut wrong = Vec::new();
    for name in targets.names {
        let mut target = (targets.target)(name);
        let mut outcomes = BTreeSet::new();
        for (path, input) in corpus(&root.join(name)) {
            match outcome(targets, &mut target, &input) {
                Ok(outcome) => drop(outcomes.insert(outcome)),
                Err(finding) => wrong.push(format!("{}: {finding}", path.display())),
            }
        }
        for seed in target.seeds.clone() {
            let outcome = outcome(targets, &mut target, &seed);
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
