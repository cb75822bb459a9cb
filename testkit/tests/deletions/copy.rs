//! A copy of the sources whose checks have switches, and its programs of tests.

use super::Removal;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;
use zk0_testkit::changed_copy::{ChangedCopy, OUT};

/// The copy.
pub struct Copy {
    copy: ChangedCopy,
    folder: PathBuf,
}

/// A program of tests of the copy.
pub struct Program {
    path: PathBuf,
    /// The folder of its package, in which cargo runs it.
    folder: PathBuf,
    /// All of its tests, with their modules.
    tests: Vec<String>,
}

/// What tests printed.
struct Ran(String);

impl Copy {
    /// Copies the sources of this workspace, but has these in place of the old ones.
    pub fn with(sources: BTreeMap<&str, String>) -> Self {
        let ours = Path::new(env!("CARGO_TARGET_TMPDIR"));
        let copy = ChangedCopy::of_workspace(ours, "deletions");
        for (file, source) in sources {
            copy.edit(file, |_| Ok(source)).expect("nothing refuses it");
        }
        // Most tests of the argument run its prover, and evaluate models. Both are built once, so it pays to build them well.
        for (package, level) in [("zk0-argument", 1), ("zk0-circuits", 0)] {
            let level_of =
                |level| format!("[profile.release.package.\"{package}\"]\nopt-level = {level}\n");
            let well = |manifest: &str| Ok(manifest.replace(&level_of(level), &level_of(3)));
            copy.edit("Cargo.toml", well).expect("nothing refuses it");
        }
        let folder = ours.join("deletions");
        Self { copy, folder }
    }

    /// Builds the program that has the test of a row.
    pub fn program(&self, removal: &Removal) -> Program {
        let (package, program) = (removal.package, removal.program());
        let ran = self.copy.run(package, program, &["--list"], &[]);
        // Cargo states: Running tests/main.rs (/…/target/release/deps/protocol-0f3a)
        let running = ran.errors.lines().find(|line| line.contains(" Running"));
        let path = running.and_then(|line| line.rsplit_once('(')?.1.strip_suffix(')'));
        let (true, Some(path)) = (ran.succeeded, path) else {
            panic!("{package}, {program}, is not built: {}", ran.errors);
        };
        let tests = ran.printed.lines();
        let tests = tests.filter_map(|line| line.strip_suffix(": test"));
        Program {
            path: self.folder.join(path),
            folder: self.folder.join(removal.folder()),
            tests: tests.map(str::to_owned).collect(),
        }
    }
}

impl Program {
    /// Demands that these tests pass with all checks: a test that fails anyway, or is not there, shows nothing when a check is out.
    pub fn passes(&self, tests: &BTreeSet<&str>) {
        let ran = self.run(tests, "");
        let passes = |test: &&&str| matches!(ran.outcomes(test)[..], [true, ..]);
        let wrong: Vec<_> = tests.iter().filter(|test| !passes(test)).collect();
        let path = self.path.display();
        assert!(
            wrong.is_empty(),
            "{path}: with all checks, these tests do not pass: {wrong:?}\n{}",
            ran.0
        );
    }

    /// Whether the test of a row fails while its check is out, or what is wrong.
    pub fn fails_without(&self, removal: &Removal) -> Result<(), String> {
        let ran = self.run(&BTreeSet::from([removal.test]), removal.check);
        match ran.outcomes(removal.test)[..] {
            [false, ..] => Ok(()),
            [true, ..] => Err(format!("{} passes without it", removal.test)),
            [] => Err(format!("{} did not end: {}", removal.test, ran.0)),
        }
    }

    /// Runs tests while a check is out.
    fn run(&self, tests: &BTreeSet<&str>, out: &str) -> Ran {
        let is_one = |test: &&String| tests.contains(own_name(test));
        let output = Command::new(&self.path)
            .args(self.tests.iter().filter(is_one))
            .arg("--exact")
            .env(OUT, out)
            .current_dir(&self.folder)
            .output()
            .expect("the program is built");
        let printed = [output.stdout, output.stderr].concat();
        Ran(String::from_utf8_lossy(&printed).into_owned())
    }
}

impl Ran {
    /// Whether the test with this name passed, once for each module that has such a test; failures come first.
    fn outcomes(&self, test: &str) -> Vec<bool> {
        let of_the_test = self.0.lines().filter_map(|line| {
            let (name, outcome) = line.strip_prefix("test ")?.split_once(" ... ")?;
            let is_it = own_name(name.trim_end_matches(" - should panic")) == test;
            (is_it && outcome != "ignored").then_some(outcome == "ok")
        });
        let mut outcomes: Vec<_> = of_the_test.collect();
        outcomes.sort();
        outcomes
    }
}

/// The name of a test without its module.
fn own_name(test: &str) -> &str {
    test.rsplit("::").next().unwrap_or(test)
}
