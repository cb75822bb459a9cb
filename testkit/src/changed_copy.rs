//! A copy of the workspace, in which code is changed and tests are run: to see what a test says when a check is gone.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The variable of the environment that names the checks which are out, with semicolons between them.
pub const OUT: &str = "ZK0_OUT";

/// `code`, in which `OUT` stands for the question whether this check is out. So one build serves many checks. Some are in hot loops, so the variable is
/// read once. It works in crates without the standard library, too.
pub fn switched(code: &str, check: &str) -> String {
    let question = format!(
        "({{ extern crate std; \
         static OUT: std::sync::LazyLock<bool> = std::sync::LazyLock::new(|| \
         std::env::var({OUT:?}).is_ok_and(|out| out.split(';').any(|one| one == {check:?}))); \
         *OUT }})"
    );
    code.replace("OUT", &question)
}

/// Code of one source that is replaced.
#[derive(Clone, Copy, Debug)]
pub struct SourceChange {
    /// The source, from the repository's folder.
    pub file: &'static str,
    /// Code that is in the source once, and what takes its place.
    pub replacements: &'static [(&'static str, &'static str)],
}

impl SourceChange {
    /// The source with the change.
    ///
    /// # Errors
    /// A piece of code is not in the source once.
    pub fn applied_to(&self, source: &str) -> Result<String, String> {
        let same = |instead: &str| instead.to_owned();
        self.applied_with(source, same)
    }

    /// The source with the change, where `instead` makes something else of the code that takes the place of the old one.
    ///
    /// # Errors
    /// A piece of code is not in the source once.
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

    /// Whether the sources of this workspace have the code that is replaced.
    ///
    /// # Errors
    /// They do not.
    pub fn fits(&self) -> Result<(), String> {
        let source = fs::read_to_string(root().join(self.file));
        let source = source.map_err(|error| format!("{}: {error}", self.file))?;
        self.applied_to(&source).map(drop)
    }
}

/// The copy. What it depends on is built as for all tests, and therefore not built again. Its binaries have a folder of their own, so that
/// no weakened `zk0` takes the place of the user's.
pub struct ChangedCopy {
    folder: PathBuf,
    build: PathBuf,
    binaries: PathBuf,
}

/// What a run of tests printed.
pub struct Ran {
    /// Whether all tests passed.
    pub succeeded: bool,
    /// What the tests printed.
    pub printed: String,
    /// What cargo and the compiler said.
    pub errors: String,
}

impl ChangedCopy {
    /// Copies the sources of this workspace into the folder `name` of `ours`, which cargo gives the programs of tests
    /// (`CARGO_TARGET_TMPDIR`).
    pub fn of_workspace(ours: &Path, name: &str) -> Self {
        let folder = ours.join(name);
        let _ = fs::remove_dir_all(&folder); // An earlier run may have left this folder
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

    /// Gives a source of the copy the text that `edit` makes of it.
    ///
    /// # Errors
    /// That of `edit`. Then the source stays as it is.
    pub fn edit(
        &self,
        file: &str,
        edit: impl FnOnce(&str) -> Result<String, String>,
    ) -> Result<(), String> {
        let place = self.folder.join(file);
        write(&place, edit(&read(&place))?);
        Ok(())
    }

    /// Makes a change, does something with the copy, and takes the change back.
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

    /// Runs tests of the program `target`, by their names. `arguments` go to the program, and so do these variables of the environment.
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
            // What links SP1 is built with the features of the whole workspace, so that SP1 is built once.
            _ => {
                cargo.arg("--workspace");
            }
        }
        // What cargo tells this test about its own package, and what scripts/run-test allows it. Build scripts that ask for it would run again, each
        // time that the other cargo has built, and with them half of what the copy depends on.
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

/// The root of the workspace.
fn root() -> &'static Path {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().expect("this crate is in a workspace")
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
        let name = name.trim_start_matches("name = ").trim_matches('"');
        let level = if name == "zk0-argument" { 1 } else { 0 };
        let table = format!("\n[profile.release.package.{name}]\n");
        // Such a table of the workspace has one line.
        if let Some((before, after)) = text.split_once(&table) {
            let (_, rest) = after.split_once('\n').expect("a line in the table");
            text = format!("{before}\n{rest}");
        }
        text += &format!("{table}opt-level = {level}\n");
    }
    write(&manifest, text);
}
