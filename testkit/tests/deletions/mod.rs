//! Shows for the checks of protocol, weights, argument, verifier, a node's secrets and stored entries that a test fails without them.
//!
//! The test makes a copy of the sources, and gives each check in it a switch that takes it out at run time ([`switch`]). So one build of each
//! program of tests is enough. The tests that try the attacks run with all checks first: all of them have to pass. Then each check is out
//! once, and the test that tries the attack which it stops has to fail. `circuits/tests/deletion.rs` does the same for the checks of the guest,
//! with cheats in place of tests.
//!
//! `make test` takes out the checks of the state machine and of the files of weights, which need no build of SP1. `make deletions` takes out
//! the others, too. `ZK0_REMOVE="a beacon;a vote" make deletions` takes out only the checks with "a beacon" or "a vote" in their names.

#[macro_use]
mod switch;

mod argument;
mod attestation;
mod bounds;
mod copy;
mod kept_state;
mod ledger_rules;
mod moments;
mod outages;
mod pruning;
mod secrets;
mod stored_entries;

use copy::{Copy, Program};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::thread;
use zk0_testkit::changed_copy::SourceChange;

/// A check, and the test that tries the attack which it stops.
struct Removal {
    check: &'static str,
    /// How the source gets the switch.
    change: SourceChange,
    /// The package of the test.
    package: &'static str,
    /// The test, without its module.
    test: &'static str,
}

/// Makes functions, each for the rows whose tests are in one package.
macro_rules! rows {
    ($($function:ident: $package:literal,)*) => {$(
        const fn $function(
            check: &'static str,
            file: &'static str,
            replacements: &'static [(&'static str, &'static str)],
            test: &'static str,
        ) -> Removal {
            let change = SourceChange { file, replacements };
            Removal { check, change, package: $package, test }
        }
    )*};
}

rows! {
    protocol: "zk0-protocol",
    weights: "zk0-weights",
    ledger: "zk0-ledger",
    circuits: "zk0-circuits",
    argument: "zk0-argument",
    verifier: "zk0-verifier",
    aggregator: "zk0-aggregator",
    node: "zk0-node",
    system: "zk0-testkit",
}

const RULES: &[&[Removal]] = &[ledger_rules::REMOVALS, bounds::REMOVALS, moments::REMOVALS];
const ARGUMENT: &[&[Removal]] = &[argument::REMOVALS];
const ATTESTATION: &[&[Removal]] = &[
    attestation::REMOVALS,
    kept_state::REMOVALS,
    outages::REMOVALS,
    pruning::REMOVALS,
    secrets::REMOVALS,
    stored_entries::REMOVALS,
];

/// All rows.
fn all() -> impl Iterator<Item = &'static Removal> {
    let tables = [RULES, ARGUMENT, ATTESTATION].into_iter().flatten();
    tables.copied().flatten()
}

impl Removal {
    /// The folder of the package.
    fn folder(&self) -> &'static str {
        self.package.trim_start_matches("zk0-")
    }

    /// The package's program of tests, as cargo names it.
    fn program(&self) -> &'static str {
        match self.folder() {
            "testkit" => "system",
            folder => folder,
        }
    }

    /// The source with the switch of this check.
    fn switched(&self, source: &str) -> Result<String, String> {
        let mut codes = self.change.replacements.iter().map(|(_, code)| code);
        if !codes.any(|code| code.contains("OUT")) {
            return Err("nothing asks its switch".into());
        }
        let switched = |code: &str| zk0_testkit::changed_copy::switched(code, self.check);
        self.change.applied_with(source, switched)
    }

    /// Whether the test is in the package's program of tests.
    fn has_test(&self) -> Result<(), String> {
        let tests = root().join(self.folder()).join("tests");
        let begin = format!("fn {}(", self.test);
        let has_it = |file: &PathBuf| fs::read_to_string(file).is_ok_and(|s| s.contains(&begin));
        match files(&tests).iter().any(has_it) {
            true => Ok(()),
            false => Err(format!("{} is not in {}", self.test, tests.display())),
        }
    }
}

/// The root of the workspace.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The files in a folder of tests and in its folders, without those of the program that runs alone.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("a folder of tests");
    let paths = entries.map(|entry| entry.expect("an entry of the folder").path());
    let paths = paths.filter(|path| !path.ends_with("alone"));
    let files = paths.map(|path| match path.is_dir() {
        true => files(&path),
        false => vec![path],
    });
    files.flatten().collect()
}

/// The sources with the switches of all checks, and what is wrong with rows.
fn switched() -> (BTreeMap<&'static str, String>, Vec<String>) {
    let (mut sources, mut wrong) = (BTreeMap::new(), vec![]);
    for removal in all() {
        let file = removal.change.file;
        let read = || fs::read_to_string(root().join(file)).unwrap_or_else(|why| why.to_string());
        let source = sources.entry(file).or_insert_with(read);
        match removal.switched(source) {
            Ok(switched) => *source = switched,
            Err(why) => wrong.push(format!("{}: {why}", removal.check)),
        }
    }
    (sources, wrong)
}

/// The copy with the switches of all checks, which all tests here share.
static COPY: LazyLock<Copy> = LazyLock::new(|| {
    let (sources, wrong) = switched();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    Copy::with(sources)
});

/// Takes the checks of these tables out, one at a time. `ZK0_REMOVE` chooses those whose name contains one of its texts.
fn removed(tables: &[&[Removal]]) {
    let chosen = std::env::var("ZK0_REMOVE").unwrap_or_default();
    let is_chosen = |removal: &&Removal| chosen.split(';').any(|text| removal.check.contains(text));
    let removals: Vec<_> = tables.iter().copied().flatten().filter(is_chosen).collect();
    let mut programs = BTreeMap::<_, Program>::new();
    for removal in &removals {
        let build = || COPY.program(removal);
        programs.entry(removal.package).or_insert_with(build);
    }
    for (package, program) in &programs {
        let own = removals.iter().filter(|one| one.package == *package);
        program.passes(&own.map(|removal| removal.test).collect());
    }
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let wrong_of = |removal: &&Removal| {
        let outcome = programs[removal.package].fails_without(removal);
        let reported = outcome.as_ref().map_or_else(String::as_str, |()| "red");
        println!("{}: {reported}", removal.check);
        Some(format!("{}: {}", removal.check, outcome.err()?))
    };
    let part = |first| {
        let own = removals.iter().skip(first).step_by(threads);
        own.filter_map(wrong_of).collect::<Vec<_>>()
    };
    let wrong: Vec<_> = thread::scope(|scope| {
        let parts: Vec<_> = (0..threads)
            .map(|first| scope.spawn(move || part(first)))
            .collect();
        let wrong = parts.into_iter().map(|part| part.join().expect("no panic"));
        wrong.flatten().collect()
    });
    println!(
        "{} of {} are red",
        removals.len() - wrong.len(),
        removals.len()
    );
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Where a source changes, the code that gives its checks switches has to change, too. All switches are in one copy, so the code of a row has to
/// be there once also after the rows before it.
#[test]
fn every_check_can_be_removed_from_the_sources() {
    let (_, mut wrong) = switched();
    let mut names = BTreeSet::new();
    for removal in all() {
        if let Err(why) = removal.has_test() {
            wrong.push(format!("{}: {why}", removal.check));
        }
        if !names.insert(removal.check) {
            wrong.push(format!("two checks have the name '{}'", removal.check));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_ledgers_rules_and_files_have_a_test_for_each_check() {
    removed(RULES);
}

#[test]
#[ignore = "removes fifty checks: make deletions"]
fn the_argument_has_a_cheat_for_each_check() {
    removed(ARGUMENT);
}

#[test]
#[ignore = "builds SP1 for the copy: make deletions"]
fn the_verifier_and_the_node_s_secrets_have_a_test_for_each_check() {
    removed(ATTESTATION);
}
