//! What the tests of the binary share: running it, and looking at files.

pub mod accepting;
pub mod drill;
pub mod made_ledger;
pub mod network;
pub mod process;
pub mod recorded;
pub mod serving;
pub mod shown;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A recording, as seen from the repository's folder.
pub const RECORDING: &str = "tests/fixtures/datasets/so100_pickplace";

/// The committed ledger, which holds a real proof.
pub const LEDGER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/fixtures/ledger");

/// The repository's folder.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Gives the cameras of LeRobot's fixture, in its configuration `file`, the names of the recordings' cameras.
pub fn name_cameras(file: &Path) {
    let mut config = fs::read_to_string(file).unwrap();
    for (fixture, recording) in [("camera1", "top"), ("camera2", "wrist")] {
        assert!(config.contains(fixture));
        config = config.replace(fixture, recording);
    }
    fs::write(file, config).unwrap();
}

/// The binary with these arguments, in the repository's folder.
pub fn zk0(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_zk0"));
    command.args(arguments).current_dir(root());
    command
}

/// What a process wrote to its standard output.
pub fn printed(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// What a process wrote to its log, which is its standard error. It is no terminal here, so it has no colours.
#[track_caller]
pub fn logged(output: &Output) -> String {
    let log = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!log.contains('\x1b'), "{log:?}");
    log
}

/// Runs a command that has to end with the exit code `code`.
#[track_caller]
pub fn ends(code: i32, mut command: Command) -> Output {
    let output = command.output().unwrap();
    assert_eq!(
        output.status.code(),
        Some(code),
        "{command:?}: {}{}",
        printed(&output),
        logged(&output)
    );
    output
}

/// The output of a run that has to succeed.
#[track_caller]
pub fn prints(arguments: &[&str]) -> String {
    printed(&ends(0, zk0(arguments)))
}

/// The log of a run that has to succeed.
#[track_caller]
pub fn logs(arguments: &[&str]) -> String {
    logged(&ends(0, zk0(arguments)))
}

/// The log of a run that has to fail.
#[track_caller]
pub fn fails(arguments: &[&str]) -> String {
    logged(&ends(1, zk0(arguments)))
}

/// The JSON that a run prints, which has to succeed.
#[track_caller]
pub fn json(arguments: &[&str]) -> serde_json::Value {
    serde_json::from_str(&prints(arguments)).unwrap()
}

/// A path as an argument.
pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Arguments that a test has made.
pub fn words(owned: &[String]) -> Vec<&str> {
    owned.iter().map(String::as_str).collect()
}

/// Checks that the output has the words, and that the runbook has them, too.
#[track_caller]
pub fn as_in_the_runbook(output: &str, symptom: &str) {
    assert!(output.contains(symptom), "{symptom:?} is not in {output}");
    let page = fs::read_to_string(root().join("docs/runbook.md")).unwrap();
    assert!(
        page.contains(symptom),
        "{symptom:?} is not in docs/runbook.md"
    );
}

/// Copies a folder with all that is in it.
pub fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for found in fs::read_dir(from).unwrap() {
        let found = found.unwrap();
        let to = to.join(found.file_name());
        match found.path().is_dir() {
            true => copy(&found.path(), &to),
            false => drop(fs::copy(found.path(), to).unwrap()),
        }
    }
}
