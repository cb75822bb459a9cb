//! `zk0 train --tensorboard`: what `metrics.jsonl` holds, also after a resume.

use super::{names, Curve};
use crate::harness::{fails, logged, text, zk0, RECORDING};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use zk0_testkit::event_files::{curves, files};
use zk0_testkit::until;

/// The arguments of a short run in `dir`, whose results go into `out`.
fn training<'a>(dir: &'a [String; 3], more: &[&'a str]) -> Vec<&'a str> {
    let [out, cache, curves] = dir;
    let mut arguments = vec!["train", "--dataset", RECORDING, "--profile", "micro"];
    arguments.extend(["--steps", "60", "--batch-size", "8", "--lr", "2e-3"]);
    arguments.extend(["--snapshot-every", "7", "--eval-episodes", "0.2"]);
    arguments.extend(["--out", out, "--cache", cache, "--tensorboard", curves]);
    arguments.extend(more);
    arguments
}

fn paths(dir: &Path) -> [String; 3] {
    ["out", "cache", "curves"].map(|name| text(&dir.join(name)).to_owned())
}

/// Values of a field in a file of metrics, by their steps.
fn of(metrics: &str, field: &str) -> Curve {
    let lines = metrics.lines().filter_map(|line| {
        let line: Value = serde_json::from_str(line).ok()?;
        Some((line["step"].as_i64()?, line[field].as_f64()? as f32))
    });
    lines.collect()
}

#[test]
fn a_run_that_was_killed_has_the_curves_of_its_metrics() {
    let dir = tempfile::tempdir().unwrap();
    let paths = paths(dir.path());
    let metrics = dir.path().join("out/metrics.jsonl");
    let text = || fs::read_to_string(&metrics).unwrap_or_default();
    let mut process = zk0(&training(&paths, &[]))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    until("there are 20 steps, or the run has ended", || {
        of(&text(), "loss").len() >= 20 || process.try_wait().unwrap().is_some()
    });
    process.kill().unwrap();
    assert!(
        !process.wait().unwrap().success(),
        "it ended before the kill"
    );

    let resumed = zk0(&training(&paths, &["--resume"])).output().unwrap();
    assert!(resumed.status.success(), "{}", logged(&resumed));
    let folder = dir.path().join("curves");
    assert_eq!(files(&folder).len(), 2);
    let (curves, text) = (curves(&folder), text());
    let fields = [
        ("eval/loss", "eval_loss"),
        ("eval/loss_plain", "eval_loss_plain"),
        ("train/grad_norm", "grad_norm"),
        ("train/loss", "loss"),
        ("train/lr", "lr"),
        ("train/update_s", "seconds"),
    ];
    assert_eq!(names(&curves), fields.map(|(name, _)| name));
    for (name, field) in fields {
        assert_eq!(curves[name], of(&text, field), "{name}");
    }
    let steps: Vec<_> = curves["train/loss"].keys().copied().collect();
    assert_eq!(steps, (1..=60).collect::<Vec<_>>());
}

#[test]
fn what_is_wrong_with_the_folder_is_said_before_the_first_step() {
    let dir = tempfile::tempdir().unwrap();
    let [out, cache, _] = paths(dir.path());
    let file = text(&dir.path().join("file")).to_owned();
    fs::write(&file, "").unwrap();
    let reported = fails(&training(&[out, cache.clone(), file.clone()], &[]));
    assert!(
        reported.contains("--tensorboard: ") && reported.contains(&file),
        "{reported}"
    );
    assert!(!dir.path().join("out/metrics.jsonl").exists());

    let [out, _, folder] = paths(dir.path());
    let made = zk0(&training(&[out, cache.clone(), folder.clone()], &[])).output();
    let made = made.unwrap();
    assert!(made.status.success(), "{}", logged(&made));
    let other = text(&dir.path().join("other")).to_owned();
    let reported = fails(&training(&[other, cache, folder.clone()], &[]));
    let why = format!("{folder} holds the curves of another run");
    assert!(reported.contains(&why), "{reported}");
}
