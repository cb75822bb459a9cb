//! A copy of the workspace, from which checks are removed one at a time.

use crate::Removal;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The copy. What it depends on is built as for all tests, and therefore not built again. Its binaries have a folder of their own, so that
/// no weakened `zk0` takes the place of the user's.
pub struct Copy {
    folder: PathBuf,
    build: PathBuf,
    binaries: PathBuf,
}

/// What became of the test when the check was gone.
pub enum Outcome {
    /// It failed, as it should.
    Red,
    /// It passed, or did not run.
    NotRed,
    /// The check was not removed, or the copy does not build.
    NotTried(String),
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Red => f.write_str("the test fails without it"),
            Self::NotRed => f.write_str("no test fails without it, or the test has another name"),
            Self::NotTried(why) => write!(f, "not tried: {why}"),
        }
    }
}

impl Copy {
    /// Copies the sources of this workspace.
    pub fn of_workspace() -> Self {
        let here = Path::new(env!("CARGO_MANIFEST_DIR"));
        let root = here.parent().expect("this crate is in a workspace");
        let ours = Path::new(env!("CARGO_TARGET_TMPDIR"));
        let folder = ours.join("deletions");
        let _ = fs::remove_dir_all(&folder); // An earlier run may have left this folder
        copy_folder(root, &folder);
        build_quickly(&folder);
        let build = ours
            .parent()
            .expect("tests have a folder in the target folder");
        Self {
            build: build.into(),
            binaries: ours.join("deletions-target"),
            folder,
        }
    }

    /// Removes a check, runs the test, and puts the check back.
    pub fn without(&self, removal: &Removal) -> Outcome {
        let place = self.folder.join(removal.file);
        let whole = read(&place);
        let source = match removal.applied_to(&whole) {
            Ok(source) => source,
            Err(why) => return Outcome::NotTried(why),
        };
        write(&place, source);
        let ran = self.run(removal.package, removal.target, &[removal.test]);
        write(&place, whole);
        match ran.outcomes(removal.test).contains(&false) {
            true => Outcome::Red,
            false if ran.succeeded => Outcome::NotRed,
            false => Outcome::NotTried(ran.printed + &ran.errors),
        }
    }

    /// Runs the tests of `removals` on the copy as it is, and returns what is wrong with them: a test that fails here anyway, or that is
    /// not there, shows nothing when a check is gone. Tests of one file run together.
    pub fn unchanged(&self, removals: &[&Removal]) -> Vec<String> {
        let mut files = BTreeMap::<_, BTreeSet<_>>::new();
        for removal in removals {
            let file = (removal.package, removal.target);
            files.entry(file).or_default().insert(removal.test);
        }
        let mut wrong = vec![];
        for ((package, target), tests) in files {
            let tests: Vec<_> = tests.into_iter().collect();
            let ran = self.run(package, target, &tests);
            let passes = |test: &&str| matches!(ran.outcomes(test)[..], [true, ..]);
            let fail = tests.iter().filter(|test| !passes(test));
            let fail: Vec<_> = fail.copied().collect();
            if !fail.is_empty() {
                let fail = fail.join(", ");
                wrong.push(format!(
                    "these tests of {package}, {target}, do not pass on the unchanged copy: {fail}\n{}{}",
                    ran.printed, ran.errors
                ));
            }
        }
        wrong
    }

    /// Runs tests of one file, by their names.
    fn run(&self, package: &str, target: &str, tests: &[&str]) -> Ran {
        let mut cargo = Command::new(env!("CARGO"));
        cargo.args(["test", "--release", "--locked", "--offline"]);
        match package {
            light @ ("zk0-argument" | "zk0-circuits" | "zk0-protocol" | "zk0-weights") => {
                cargo.args(["--package", light]);
            }
            // What links SP1 is built with the features of the whole workspace, so that SP1 is built once.
            _ => {
                cargo.arg("--workspace");
            }
        }
        let output = cargo
            .args(["--test", target, "--"])
            .args(tests)
            .env("CARGO_BUILD_BUILD_DIR", &self.build)
            .env("CARGO_TARGET_DIR", &self.binaries)
            .current_dir(&self.folder)
            .output()
            .expect("cargo runs");
        Ran {
            succeeded: output.status.success(),
            printed: String::from_utf8_lossy(&output.stdout).into_owned(),
            errors: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }
}

/// What a run of tests printed.
struct Ran {
    succeeded: bool,
    printed: String,
    errors: String,
}

impl Ran {
    /// Whether the test with this name passed, once for each module that has such a test; failures come first.
    fn outcomes(&self, test: &str) -> Vec<bool> {
        let of_the_test = self.printed.lines().filter_map(|line| {
            let rest = line.strip_prefix("test ")?;
            let (name, outcome) = rest.split_once(" ... ")?;
            let name = name.trim_end_matches(" - should panic");
            let is_it = name.rsplit("::").next() == Some(test);
            (is_it && outcome != "ignored").then_some(outcome == "ok")
        });
        let mut outcomes: Vec<_> = of_the_test.collect();
        outcomes.sort();
        outcomes
    }
}

/// Copies the files of a folder, without build outputs, results of demos, and version control.
fn copy_folder(from: &Path, to: &Path) {
    let entries = fs::read_dir(from).unwrap_or_else(|error| panic!("{}: {error}", from.display()));
    for entry in entries {
        let path = entry.expect("an entry of the folder").path();
        let name = path.file_name().expect("an entry has a name");
        if ["target", "outputs", ".git"]
            .iter()
            .any(|left_out| name == *left_out)
        {
            continue;
        }
        let to = to.join(name);
        match path.is_dir() {
            true => copy_folder(&path, &to),
            false => {
                let parent = to.parent().expect("a file in a folder");
                fs::create_dir_all(parent)
                    .and_then(|()| fs::copy(&path, &to).map(drop))
                    .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            }
        }
    }
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn write(path: &Path, content: impl AsRef<[u8]>) {
    fs::write(path, content).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
}

/// Has the crates of the copy built quickly rather than well, but for the argument, whose provers calculate long. What they depend on is built
/// as it is for the tests.
fn build_quickly(folder: &Path) {
    let manifest = folder.join("Cargo.toml");
    let mut text = read(&manifest).replace("\nincremental = false\n", "\nincremental = true\n");
    for entry in fs::read_dir(folder).expect("the folder was just made") {
        let member = entry
            .expect("an entry of the folder")
            .path()
            .join("Cargo.toml");
        let Ok(member) = fs::read_to_string(member) else {
            continue;
        };
        let name = member.lines().find(|line| line.starts_with("name = "));
        let name = name.expect("a line 'name = …' in a crate's Cargo.toml");
        let name = name.trim_start_matches("name = ");
        let level = if name == "\"zk0-argument\"" { 1 } else { 0 };
        text += &format!("\n[profile.release.package.{name}]\nopt-level = {level}\n");
    }
    write(&manifest, text);
}
