//! A copy of the workspace, from which checks are removed one at a time.

use crate::Removal;
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
            .env("CARGO_BUILD_BUILD_DIR", &self.build)
            .env("CARGO_TARGET_DIR", &self.binaries)
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

/// Has the crates of the copy built quickly rather than well. What they depend on is built as it is for the tests.
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
        text += &format!("\n[profile.release.package.{name}]\nopt-level = 0\n");
    }
    write(&manifest, text);
}
