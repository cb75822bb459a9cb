//! `zk0 train` with image transforms: training frames are transformed, held-out frames are not, and a run can be resumed.

use crate::harness::{ends, logged, zk0, RECORDING};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Command;

/// `zk0 train` on a recording, micro profile, with a cache in `dir`.
fn train(dir: &Path, out: &str, more: &[&str]) -> Command {
    let mut command = zk0(&[
        "train",
        "--dataset",
        RECORDING,
        "--lr",
        "2e-3",
        "--profile",
        "micro",
    ]);
    command.args([
        "--steps",
        "12",
        "--batch-size",
        "8",
        "--eval-episodes",
        "0.2",
    ]);
    command.arg("--out").arg(dir.join(out));
    command.arg("--cache").arg(dir.join("cache")).args(more);
    command
}

fn model(dir: &Path, out: &str) -> Vec<u8> {
    fs::read(dir.join(out).join("model.safetensors")).unwrap()
}

/// The losses of steps, and those on held-out episodes.
fn losses(dir: &Path, out: &str) -> (Vec<f64>, Vec<f64>) {
    let metrics = fs::read_to_string(dir.join(out).join("metrics.jsonl")).unwrap();
    let lines = metrics
        .lines()
        .map(|line| serde_json::from_str(line).unwrap());
    let lines: Vec<Value> = lines.collect();
    let of = |name: &str| {
        lines
            .iter()
            .filter_map(|line| line[name].as_f64())
            .collect()
    };
    (of("loss"), of("eval_loss"))
}

#[test]
fn held_out_frames_are_never_transformed() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    ends(0, train(dir, "plain", &[]));
    let on = ["--image-transforms", "--image-variants", "3"];
    ends(0, train(dir, "transformed", &on));
    ends(0, train(dir, "again", &on));
    assert!(
        model(dir, "transformed") == model(dir, "again"),
        "the seed decides"
    );
    assert!(model(dir, "transformed") != model(dir, "plain"));

    // Before the first step, both runs have the same weights, and so the same loss on the same frames.
    let (plain, transformed) = (losses(dir, "plain"), losses(dir, "transformed"));
    assert_eq!(plain.1[0], transformed.1[0]);
    assert_ne!(plain.0[0], transformed.0[0]);

    let run = fs::read(dir.join("transformed/run.json")).unwrap();
    let run: Value = serde_json::from_slice(&run).unwrap();
    let transforms = &run["image_transforms"];
    assert_eq!(transforms["enable"], true);
    assert_eq!(transforms["variants"], 3);
    assert_eq!(transforms["tfs"]["hue"]["kwargs"]["hue"][1], 0.05);

    // A run does not go on with other transforms.
    let other = ["--image-transforms", "--image-variants", "2", "--resume"];
    let refused = logged(&ends(1, train(dir, "transformed", &other)));
    assert!(refused.contains("another run"), "{refused}");
}

#[test]
fn the_configuration_is_read_as_lerobot_writes_it() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let file = dir.join("train_config.json");
    let with = |text: &str, more: &[&str]| {
        fs::write(&file, text).unwrap();
        let mut command = train(dir, "new", more);
        command.arg("--image-transforms-config").arg(&file);
        command
    };
    let tfs =
        r#"{"mine": {"weight": 1.0, "type": "ColorJitter", "kwargs": {"brightness": [0.5, 0.6]}}}"#;
    let whole = format!(
        r#"{{"steps": 5, "dataset": {{"repo_id": "x", "image_transforms": {{"enable": true, "tfs": {tfs}}}}}}}"#
    );
    ends(0, with(&whole, &[]));
    let run: Value = serde_json::from_slice(&fs::read(dir.join("new/run.json")).unwrap()).unwrap();
    let found = &run["image_transforms"]["tfs"];
    assert_eq!(found["mine"]["kwargs"]["brightness"][0], 0.5);
    assert_eq!(found.as_object().unwrap().len(), 1);

    let refused = |text: &str, more: &[&str]| logged(&ends(1, with(text, more)));
    let off = refused(r#"{"enable": false}"#, &[]);
    assert!(off.contains("add --image-transforms"), "{off}");
    let unknown = refused(&whole.replace("ColorJitter", "Blur"), &[]);
    assert!(
        unknown.contains("`mine`: no type is called `Blur`"),
        "{unknown}"
    );
    let broken = refused("{", &[]);
    assert!(broken.contains("train_config.json"), "{broken}");
    let many = refused(r#"{"enable": true}"#, &["--image-variants", "1001"]);
    assert!(many.contains("1001 image variants"), "{many}");
    let alone = logged(&ends(1, train(dir, "new", &["--image-variants", "3"])));
    assert!(alone.contains("--image-variants is given"), "{alone}");
}
