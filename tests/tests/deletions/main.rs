//! Shows for the checks of protocol, weights, argument, verifier, ledger, audit and node that a test fails without them.
//!
//! The test copies the sources, and runs the tests that try the attacks: all of them have to pass. Then it removes one check at a time from
//! the copy, and runs the test that tries the attack which the check stops. Now that test has to fail.
//! `circuits/tests/deletion.rs` does the same for the checks of the guest, with cheats in place of tests.
//!
//! `make test` removes the checks of the state machine and of the files of weights, which need no build of SP1. `make deletions` removes
//! the others, too. `ZK0_REMOVE="a beacon;a vote" make deletions` removes only the checks with "a beacon" or "a vote" in their names.

mod argument;
mod attestation;
mod audited;
mod bounds;
mod copy;
mod faults;
mod kept_blobs;
mod ledger_rules;
mod moments;
mod nodes;
mod proving;
mod pruned;
mod service;
mod traces;

use copy::{Copy, Outcome};
use std::fs;
use std::path::{Path, PathBuf};
use zk0_tests::changed_copy::Change;

/// A check, and the test that tries the attack which it stops.
#[derive(Clone)]
pub struct Removal {
    pub check: &'static str,
    /// The source, from the repository's folder.
    pub file: &'static str,
    /// Code that is in the source once, and what takes its place.
    pub replacements: &'static [(&'static str, &'static str)],
    pub package: &'static str,
    /// The file of tests, as cargo names it.
    pub target: &'static str,
    /// The test, without its module.
    pub test: &'static str,
}

impl Removal {
    /// The change that takes the check out.
    fn change(&self) -> Change {
        Change {
            file: self.file,
            replacements: self.replacements,
        }
    }

    /// Whether the check is in its source, and the test in its file of tests.
    fn fits(&self) -> Result<(), String> {
        self.change().fits()?;
        let package = match self.package {
            "zk0" => "cli",
            other => other.trim_start_matches("zk0-"),
        };
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let tests = root.join(package).join("tests").join(self.target);
        let begin = format!("fn {}(", self.test);
        let mut sources = sources(&tests);
        sources.push(tests.with_extension("rs"));
        let has_it = |file: &PathBuf| fs::read_to_string(file).is_ok_and(|s| s.contains(&begin));
        match sources.iter().any(has_it) {
            true => Ok(()),
            false => Err(format!("{} is not in {}", self.test, tests.display())),
        }
    }
}

/// The files in a folder and in its folders. None if there is no such folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else {
        return vec![];
    };
    let paths = entries.map(|entry| entry.expect("an entry of the folder").path());
    let files = paths.map(|path| match path.is_dir() {
        true => sources(&path),
        false => vec![path],
    });
    files.flatten().collect()
}

/// Removes the checks of these lists, one at a time. `ZK0_REMOVE` chooses those whose name contains one of its texts.
fn removed(lists: &[&[Removal]]) {
    let chosen = std::env::var("ZK0_REMOVE").unwrap_or_default();
    let all = lists.iter().copied().flatten();
    let removals: Vec<_> = all
        .filter(|removal| chosen.split(';').any(|text| removal.check.contains(text)))
        .collect();
    let copy = Copy::of_workspace();
    let wrong = copy.unchanged(&removals);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let mut wrong = vec![];
    for (number, removal) in removals.iter().enumerate() {
        let outcome = copy.without(removal);
        println!(
            "{}/{} {}: {outcome}",
            number + 1,
            removals.len(),
            removal.check
        );
        if !matches!(outcome, Outcome::Red) {
            wrong.push(format!("{}: {outcome}", removal.check));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_check_can_be_removed_from_the_sources() {
    let lists = [
        ledger_rules::REMOVALS,
        bounds::REMOVALS,
        moments::REMOVALS,
        argument::REMOVALS,
        attestation::REMOVALS,
        audited::REMOVALS,
        nodes::REMOVALS,
        proving::REMOVALS,
        pruned::REMOVALS,
        service::REMOVALS,
        faults::REMOVALS,
        traces::REMOVALS,
        kept_blobs::REMOVALS,
    ];
    let wrong: Vec<_> = lists
        .concat()
        .iter()
        .filter_map(|removal| {
            let why = removal.fits().err()?;
            Some(format!("{}: {why}", removal.check))
        })
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_ledgers_rules_and_files_have_a_test_for_each_check() {
    removed(&[ledger_rules::REMOVALS, bounds::REMOVALS, moments::REMOVALS]);
}

#[test]
#[ignore = "removes fifty checks: make deletions"]
fn the_argument_has_a_cheat_for_each_check() {
    removed(&[argument::REMOVALS]);
}

#[test]
#[ignore = "builds SP1 for the copy: make deletions"]
fn verifier_ledger_and_audit_have_a_test_for_each_check() {
    removed(&[
        attestation::REMOVALS,
        audited::REMOVALS,
        nodes::REMOVALS,
        proving::REMOVALS,
        pruned::REMOVALS,
        service::REMOVALS,
        faults::REMOVALS,
        traces::REMOVALS,
        kept_blobs::REMOVALS,
    ]);
}
