//! The programs that show how the crates are used do what their first lines promise, on the fixtures.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::{env, fs};

/// The program of the example `name`.
pub fn built(name: &str) -> PathBuf {
    let this = env::current_exe().unwrap();
    let release = this.ancestors().nth(2).unwrap();
    let example = release.join("examples").join(name);
    assert!(
        example.exists(),
        "{} is not built: cargo build --release --workspace --locked --examples",
        example.display()
    );
    example
}

/// Runs the example `name`.
fn run(name: &str, arguments: &[&Path]) -> Output {
    Command::new(built(name)).args(arguments).output().unwrap()
}

/// What it prints, if it ends well.
fn printed(output: Output) -> String {
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    String::from_utf8(output.stdout).unwrap()
}

/// The root of the repository.
pub fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

pub fn fixture(path: &str) -> PathBuf {
    root().join("tests/fixtures").join(path)
}

#[test]
fn a_log_is_followed() {
    let folder = tempfile::tempdir().unwrap();
    let (export, kept) = (fixture("export"), folder.path().join("checkpoint"));
    let follow = || run("follow_log", &[&export, &kept]);
    assert_eq!(printed(follow()).lines().count(), 17);
    assert_eq!(printed(follow()), "", "nothing is new");
    // A checkpoint of another history.
    let mut known = fs::read_to_string(&kept).unwrap();
    let line = known.find("XgUL").unwrap();
    known.replace_range(line..line + 1, "Y");
    fs::write(&kept, known).unwrap();
    assert!(!follow().status.success());
}

#[test]
fn a_ledger_is_verified() {
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("ledger");
    let copied = Command::new("cp")
        .arg("-r")
        .args([&fixture("ledger"), &copy])
        .status()
        .unwrap();
    assert!(copied.success());
    let text = printed(run("verify_ledger", &[&copy]));
    assert!(text.contains("VERIFIED"), "{text}");
    let none = tempfile::tempdir().unwrap();
    assert!(!run("verify_ledger", &[none.path()]).status.success());
}

#[test]
fn a_proof_is_checked() {
    let full = fixture("full_size");
    let [proof, claim, input] = ["proof.bin", "claim.bin", "input.bin"].map(|name| full.join(name));
    let key = |mode: &str| root().join(format!("circuits/elf/{mode}.vk"));
    let check = |mode| run("check_proof", &[&proof, &claim, &key(mode)]);
    assert!(printed(check("succinct")).starts_with("the proof holds"));
    assert!(
        !check("direct").status.success(),
        "a proof of another program"
    );
    let text = printed(run("check_argument", &[&input]));
    assert!(text.starts_with("the argument holds"), "{text}");
}

#[test]
fn a_recording_is_read() {
    let text = printed(run(
        "read_recording",
        &[&fixture("datasets/so100_pickplace")],
    ));
    assert!(text.contains("observation.images."), "{text}");
}
