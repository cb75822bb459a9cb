//! A copy of the workspace with changed code, to see which tests fail without a check.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The variable of removed checks, separated by semicolons.
pub const OUT: &str = "ZK0_OUT";

/// `code`, in which `OUT` decides whether this check is out: one build serves many. It reads the variable once, for hot loops, and works
/// without the standard library.
pub fn switched(code: &str, check: &str) -> String {
    let question = format!(
        "({{ extern crate std; \
         static OUT: std::sync::LazyLock<bool> = std::sync::LazyLock::new(|| \
         std::env::var({OUT:?}).is_ok_and(|out| out.split(';').any(|one| one == {check:?}))); \
         *OUT }})"
    );
    code.replace("OUT", &question)
}

/// A change of one source.
#[derive(Clone, Copy, Debug)]
pub struct SourceChange {
    /// From the repository's folder.
    pub file: &'static str,
    /// Code found once, and its replacement.
    pub replacements: &'static [(&'static str, &'static str)],
}

impl SourceChange {
    /// The changed source.
    ///
    /// # Errors
    /// Code is not found exactly once.
    pub fn applied_to(&self, source: &str) -> Result<String, String> {
        let same = |instead: &str| instead.to_owned();
        self.applied_with(source, same)
    }

    /// [`Self::applied_to`], where `instead` changes the replacement.
    ///
    /// # Errors
    /// The same.
    pub fn applied_with(
        &self,
        source: &str,
        instead: impl Fn(&str) -> String,
    ) -> Result<String, String> {
        let mut left = source.to_owned();
        for (code, other) in self.replacements {
            match left.matches(code).count() {
                1 => left = left.replace(code, &instead(other)),
                found => {
                    return Err(format!(
                        "`{code}` has to be in {} once, and it is there {found} times",
                        self.file
                    ))
                }
            }
        }
        Ok(left)
    }

    /// Checks that this workspace has the code.
    ///
    /// # Errors
    /// It does not.
    pub fn fits(&self) -> Result<(), String> {
        let source = fs::read_to_string(root().join(self.file));
        let source = source.map_err(|error| format!("{}: {error}", self.file))?;
        self.applied_to(&source).map(drop)
    }
}

/// The copy. It shares built dependencies, but not binaries: no weakened `zk0` replaces the user's.
pub struct ChangedCopy {
    folder: PathBuf,
    build: PathBuf,
    binaries: PathBuf,
}

/// What tests printed.
pub struct Ran {
    /// Whether all passed.
    pub succeeded: bool,
    /// The tests' output.
    pub printed: String,
    /// Output of cargo and the compiler.
    pub errors: String,
}

impl ChangedCopy {
    /// Copies the sources into `name` in `ours`, the test's `CARGO_TARGET_TMPDIR`.
    pub fn of_workspace(ours: &Path, name: &str) -> Self {
        let folder = ours.join(name);
        let _ = fs::remove_dir_all(&folder); // An earlier run may have left it
        copy_folder(root(), &folder);
        build_quickly(&folder);
        let build = ours
            .parent()
            .expect("tests have a folder in the target folder");
        Self {
            build: build.into(),
            binaries: ours.join(format!("{name}-target")),
            folder,
        }
    }

    /// Replaces a source by the result of `edit`.
    ///
    /// # Errors
    /// That of `edit`; the source stays.
    pub fn edit(
        &self,
        file: &str,
        edit: impl FnOnce(&str) -> Result<String, String>,
    ) -> Result<(), String> {
        let place = self.folder.join(file);
        write(&place, edit(&read(&place))?);
        Ok(())
    }

    /// Runs `what` under a change.
    ///
    /// # Errors
    /// The change does not fit the sources.
    pub fn with<R>(
        &self,
        change: &SourceChange,
        what: impl FnOnce(&Self) -> R,
    ) -> Result<R, String> {
        let place = self.folder.join(change.file);
        let whole = read(&place);
        write(&place, change.applied_to(&whole)?);
        let result = what(self);
        write(&place, whole);
        Ok(result)
    }

    /// Runs tests of `target` with these arguments and variables.
    pub fn run(
        &self,
        package: &str,
        target: &str,
        arguments: &[&str],
        environment: &[(&str, &str)],
    ) -> Ran {
        let mut cargo = Command::new(env!("CARGO"));
        cargo.args(["test", "--release", "--locked", "--offline"]);
        match package {
            light @ ("zk0-argument" | "zk0-circuits" | "zk0-protocol" | "zk0-weights") => {
                cargo.args(["--package", light]);
            }
            // SP1's dependents get the whole workspace's features: then SP1 is built once.
            _ => {
                cargo.arg("--workspace");
            }
        }
        // Cargo's variables for this test, and those of scripts/run-test. Build scripts that read them would run again each time, and
        // rebuild half of the dependencies.
        for (name, _) in env::vars_os() {
            let told = name.to_str().is_some_and(|name| {
                [
                    "CARGO_PKG_",
                    "CARGO_MANIFEST_",
                    "CARGO_CRATE_",
                    "RUSTC_BOOTSTRAP",
                ]
                .iter()
                .any(|prefix| name.starts_with(prefix))
            });
            if told {
                cargo.env_remove(name);
            }
        }
        let output = cargo
            .args(["--test", target, "--"])
            .args(arguments)
            .envs(environment.iter().copied())
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

fn root() -> &'static Path {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().expect("this crate is in a workspace")
}

/// Leaves out build outputs, results of demos, and version control.
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
        if path.is_dir() {
            copy_folder(&path, &to)
        } else {
            let parent = to.parent().expect("a file in a folder");
            fs::create_dir_all(parent)
                .and_then(|()| fs::copy(&path, &to).map(drop))
                .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        }
    }
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn write(path: &Path, content: impl AsRef<[u8]>) {
    fs::write(path, content).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
}

/// Turns off optimisation, except for the argument's slow provers and the dependencies.
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
        let name = name.trim_start_matches("name = ").trim_matches('"');
        let level = if name == "zk0-argument" { 1 } else { 0 };
        let table = format!("\n[profile.release.package.{name}]\n");
        // Such a table has one line here.
        if let Some((before, after)) = text.split_once(&table) {
            let (_, rest) = after.split_once('\n').expect("a line in the table");
            text = format!("{before}\n{rest}");
        }
        text += &format!("{table}opt-level = {level}\n");
    }
    write(&manifest, text);
}
