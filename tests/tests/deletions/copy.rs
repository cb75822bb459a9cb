//! A copy of the workspace, from which checks are removed one at a time.

use crate::Removal;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The copy. It lies in the target folder, and has a target folder of its own, so that later runs build only what has changed.
pub struct Copy {
    folder: PathBuf,
    target: PathBuf,
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
        let manifest = folder.join("Cargo.toml");
        write(&manifest, read(&manifest).replace(PROFILE, QUICK_PROFILE));
        let beside = ours.parent().and_then(Path::to_str);
        let beside = beside.expect("the target folder has a name");
        Self {
            folder,
            target: format!("{beside}-deletions").into(),
        }
    }

    /// Removes a check, runs the test, and puts the check back.
    pub fn without(&self, removal: &Removal) -> Outcome {
        let place = self.folder.join(removal.file);
        let whole = read(&place);
        let mut source = whole.clone();
        for (code, left) in removal.replacements {
            let found = source.matches(code).count();
            if found != 1 {
                return Outcome::NotTried(format!(
                    "`{code}` has to be in {} once, and it is there {found} times",
                    removal.file
                ));
            }
            source = source.replace(code, left);
        }
        write(&place, source);
        let outcome = self.run(removal);
        write(&place, whole);
        outcome
    }

    fn run(&self, removal: &Removal) -> Outcome {
        let mut cargo = Command::new(env!("CARGO"));
        cargo.args(["test", "--release", "--locked", "--offline"]);
        match removal.package {
            light @ ("zk0-protocol" | "zk0-weights") => {
                cargo.args(["--package", light]);
            }
            // What links SP1 is built with the features of the whole workspace, so that SP1 is built once.
            _ => {
                cargo.arg("--workspace");
            }
        }
        let output = cargo
            .args(["--test", removal.target, removal.test])
            .env("CARGO_TARGET_DIR", &self.target)
            .current_dir(&self.folder)
            .output()
            .expect("cargo runs");
        let printed = String::from_utf8_lossy(&output.stdout);
        let of_the_test = printed.lines().filter(|line| {
            let name = line
                .strip_prefix("test ")
                .and_then(|rest| rest.split(' ').next());
            name.and_then(|name| name.rsplit("::").next()) == Some(removal.test)
        });
        let mut outcomes = of_the_test.map(|line| line.ends_with("FAILED"));
        match outcomes.any(|failed| failed) {
            true => Outcome::Red,
            false if output.status.success() => Outcome::NotRed,
            false => {
                let errors = String::from_utf8_lossy(&output.stderr);
                Outcome::NotTried(format!("{printed}{errors}"))
            }
        }
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

/// Our crates build quickly, and what they depend on is built once, as for all tests.
const PROFILE: &str = "[profile.release]\ndebug = false\nincremental = false\n";
const QUICK_PROFILE: &str = "[profile.release]\ndebug = false\nincremental = true\nopt-level = 0\n
[profile.release.package.\"*\"]\nopt-level = 3\n";
