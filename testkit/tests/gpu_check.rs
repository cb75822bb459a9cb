//! `scripts/gpu-check` and `scripts/gpu-pack`, on the CPU. A proof takes 20 GiB of memory for itself, so that no step makes one here.

use crate::examples::{built, fixture, root};
use serde_json::Value;
use std::fs;
use std::os::unix::fs::{symlink, PermissionsExt};
use std::path::Path;
use std::process::{Command, Output};

const STEPS: [&str; 7] = [
    "device",
    "train",
    "train-cpu",
    "loss",
    "prove-micro",
    "prove-full",
    "train-pytorch",
];

fn script(name: &str) -> Command {
    Command::new(root().join("scripts").join(name))
}

/// A folder as in a pack, but without the program that proves.
fn without_prover() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for file in [
        built("train_step"),
        root().join("scripts/bench-train/torch_step.py"),
        fixture("full_size/input.bin"),
    ] {
        symlink(&file, folder.path().join(file.file_name().unwrap())).unwrap();
    }
    folder
}

fn json(line: &str) -> Value {
    serde_json::from_str(line).unwrap_or_else(|error| panic!("{line}: {error}"))
}

/// Runs a check in which steps fail, and returns the lines of all steps.
fn failing_check(options: &[&str], pack: &Path) -> Vec<Value> {
    let mut check = script("gpu-check");
    check.args(["--device", "cpu"]).args(options).arg(pack);
    let Output {
        status,
        stdout,
        stderr,
    } = check.output().unwrap();
    let errors = String::from_utf8_lossy(&stderr);
    assert_eq!(status.code(), Some(1), "{errors}");
    let text = String::from_utf8(stdout).unwrap();
    let lines: Vec<Value> = text.lines().map(json).collect();
    let steps: Vec<_> = lines.iter().map(|line| line["step"].as_str()).collect();
    assert_eq!(steps, STEPS.map(Some), "{text}{errors}");
    lines
}

/// Why a step failed.
fn reason(line: &Value) -> &str {
    let reason = line["failed"].as_str();
    reason.unwrap_or_else(|| panic!("it did not fail: {line}"))
}

#[test]
fn steps_go_on_after_one_that_fails() {
    let folder = without_prover();
    let kept = folder.path().join("kept");
    let options = ["--policy", "tiny", "--keep", kept.to_str().unwrap()];
    let lines = failing_check(&options, folder.path());
    let [device, train, train_cpu, loss, micro, full, pytorch] = &lines[..] else {
        panic!("{lines:?}");
    };
    for done in [device, train, train_cpu, loss, pytorch] {
        assert_eq!(done["failed"], Value::Null, "{done}");
    }
    assert_eq!(device["result"]["device"], "cpu");
    for trained in [train, train_cpu] {
        let [first, last] = ["first_loss", "loss"].map(|name| trained["result"][name].as_f64());
        assert!(first.unwrap() > 0.0 && first != last, "{trained}");
    }
    assert_eq!(loss["result"]["first_loss"], train["result"]["first_loss"]);
    for missing in [micro, full] {
        assert!(reason(missing).contains("prove_synthetic"), "{missing}");
    }
    let printed = fs::read_to_string(kept.join("train.out")).unwrap();
    assert_eq!(json(printed.trim_end()), train["result"]);
}

#[test]
fn a_step_that_takes_too_long_is_ended() {
    let folder = without_prover();
    // Three seconds for four training steps at the published size.
    let lines = failing_check(&["--seconds", "16"], folder.path());
    assert!(
        reason(&lines[1]).starts_with("ran out of its "),
        "{lines:?}"
    );
    let later = reason(&lines[3]);
    assert!(
        ["there are not two losses", "no time was left for it"].contains(&later),
        "{later}"
    );
}

#[test]
fn losses_that_are_apart_are_a_failure() {
    let folder = tempfile::tempdir().unwrap();
    // In place of a GPU that computes wrongly, which is not here: a program with another loss on each call.
    let program = folder.path().join("train_step");
    let text = r#"#!/bin/sh
echo >>"$0.calls"
echo "{\"first_loss\":1.$(wc -l <"$0.calls"),\"loss\":1.0}"
"#;
    fs::write(&program, text).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let lines = failing_check(&[], folder.path());
    assert_eq!(lines[3]["result"]["first_loss"], 1.1);
    assert!(
        reason(&lines[3]).contains("apart by more than 1 %"),
        "{lines:?}"
    );
}

#[test]
fn a_pack_holds_what_the_check_needs_and_a_large_one_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let pack = folder.path().join("zk0-gpu.tar.xz");
    let examples = built("train_step");
    let pack_into = |examples: &Path, limit: &str| {
        let mut command = script("gpu-pack");
        // The quickest compression.
        command.env("XZ_OPT", "-0").arg(examples).arg(&pack);
        command.arg(limit).output().unwrap()
    };
    let refused = |output: Output, why: &str| {
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && errors.contains(why), "{errors}");
        assert!(!pack.exists());
    };
    let examples = examples.parent().unwrap();
    refused(pack_into(folder.path(), "40"), "has no train_step");
    refused(pack_into(examples, "1"), "\"prove_synthetic_bytes\":");

    let made = pack_into(examples, "400");
    let errors = String::from_utf8_lossy(&made.stderr);
    assert!(made.status.success(), "{errors}");
    let sizes: Value = serde_json::from_slice(&made.stdout).unwrap();
    let packed = pack.metadata().unwrap().len();
    assert_eq!(sizes["pack_bytes"], packed);
    let listed = Command::new("tar").arg("-tf").arg(&pack).output().unwrap();
    let listed = String::from_utf8(listed.stdout).unwrap();
    let held: Vec<_> = listed.lines().collect();
    let names = [
        "",
        "gpu-check",
        "input.bin",
        "prove_synthetic",
        "torch_step.py",
        "train_step",
    ];
    assert_eq!(held, names.map(|name| format!("zk0-gpu/{name}")));

    // It is unpacked, and its steps have no time.
    for line in &failing_check(&["--seconds", "1"], &pack)[..6] {
        assert_eq!(reason(line), "no time was left for it");
    }
    let other = script("gpu-check")
        .arg(fixture("proof.bin"))
        .output()
        .unwrap();
    assert_eq!(other.status.code(), Some(2));
}
