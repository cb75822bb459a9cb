//! `zk0 simulate --tensorboard`: what the files of rounds hold.

use super::names;
use crate::harness::{fails, prints, text};
use serde_json::Value;
use std::fs;
use std::path::Path;
use zk0_testkit::event_files::{curves, files};

fn simulating<'a>(out: &'a str, folder: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut arguments = vec![
        "simulate",
        "--no-cache",
        "--steps",
        "8",
        "--batch-size",
        "4",
    ];
    arguments.extend(["--dataset", "tests/fixtures/datasets/so100_pickplace"]);
    arguments.extend(["--dataset", "tests/fixtures/datasets/so100_stacking"]);
    arguments.extend(["--unseen", "tests/fixtures/datasets/so100_sorting_two"]);
    arguments.extend(["--eval-frames", "8", "--out", out, "--tensorboard", folder]);
    arguments.extend(more);
    arguments
}

fn round(out: &str, number: i64) -> Value {
    let path = Path::new(out).join(format!("round_{number}.json"));
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn each_node_is_a_run_and_a_resumed_simulation_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| text(&dir.path().join(name)).to_owned();
    let (out, folder) = (path("out"), path("curves"));
    prints(&simulating(&out, &folder, &["--rounds", "1"]));
    prints(&simulating(&out, &folder, &["--rounds", "2", "--resume"]));
    let of = |run: &str| curves(&Path::new(&folder).join(run));
    let number = |value: &Value| value.as_f64().unwrap() as f32;
    let (global, node, unseen) = (of("global"), of("node-2"), of("unseen-1-so100_sorting_two"));
    assert_eq!(files(&Path::new(&folder).join("global")).len(), 2);
    assert_eq!(
        names(&node),
        [
            "eval/loss",
            "train/grad_norm",
            "train/loss",
            "train/lr",
            "zk0/round"
        ]
    );
    for made in 0..=2 {
        let (round, step) = (round(&out, made), 8 * made);
        assert_eq!(global["eval/loss"][&step], number(&round["mean_loss"]));
        assert_eq!(node["eval/loss"][&step], number(&round["nodes"][1]["loss"]));
        assert_eq!(
            unseen["eval/loss"][&step],
            number(&round["unseen"][0]["loss"])
        );
        assert_eq!(node["zk0/round"][&step], made as f32);
        if made > 0 {
            let told = &round["individual_client_metrics"][1];
            assert_eq!(node["train/loss"][&step], number(&told["loss"]));
            assert_eq!(node["train/grad_norm"][&step], number(&told["grad_norm"]));
            assert!(node["train/lr"][&step] > 0.0);
            let told = &round["aggregated_client_metrics"]["avg_client_loss"];
            assert_eq!(global["train/loss"][&step], number(told));
        }
    }
    assert_eq!(node["train/loss"].len(), 2);

    let reported = fails(&simulating(&path("other"), &folder, &["--rounds", "1"]));
    assert!(
        reported.contains("holds the curves of another run"),
        "{reported}"
    );
}
