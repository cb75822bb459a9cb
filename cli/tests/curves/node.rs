//! `zk0 node join --tensorboard`: the steps of one round follow those of the rounds before, also when the node was started again.

use super::names;
use crate::harness::logged;
use crate::harness::network::LocalNetwork;
use serde_json::Value;
use std::fs;
use std::path::Path;
use zk0_testkit::event_files::curves;

#[test]
fn the_curves_of_a_node_go_on_from_round_to_round() {
    let network = LocalNetwork::new();
    network.found_with_short_rounds();
    let folder = network.path("curves");
    let training = [
        "--steps",
        "200",
        "--batch-size",
        "16",
        "--learning-rate",
        "5e-4",
    ];
    let options = [&training[..], &["--tensorboard", &folder]].concat();
    let reported = [network.joins(1, &options), network.joins(1, &options)];
    let proven = reported
        .iter()
        .filter(|reported| reported.contains("submits the claim"));
    let proven = proven.count();
    let curves = curves(Path::new(&folder));
    let round = |number: usize| -> Vec<f32> {
        let path = network.path(&format!("state/round-{number}.training.json"));
        let history: Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
        let losses = history["losses"].as_array().unwrap().iter();
        losses.map(|loss| loss.as_f64().unwrap() as f32).collect()
    };
    let losses: Vec<_> = curves["train/loss"].values().copied().collect();
    assert_eq!(losses, [round(0), round(1)].concat());
    let steps: Vec<_> = curves["train/loss"].keys().copied().collect();
    assert_eq!(steps, (1..=400).collect::<Vec<_>>());
    assert_eq!(curves["zk0/round"][&200], 0.0);
    assert_eq!(curves["zk0/round"][&201], 1.0);
    let of_training = [
        "train/grad_norm",
        "train/loss",
        "train/lr",
        "train/update_s",
        "zk0/round",
    ];
    let of_claims = ["eval/base_loss", "eval/loss"];
    match proven {
        0 => assert_eq!(names(&curves), of_training),
        _ => {
            assert_eq!(names(&curves), [&of_claims[..], &of_training].concat());
            assert_eq!(curves["eval/loss"].len(), proven);
            let (step, after) = curves["eval/loss"].first_key_value().unwrap();
            assert!([200, 400].contains(step) && *after < curves["eval/base_loss"][step]);
        }
    }
}

#[test]
fn a_node_whose_curves_cannot_be_written_ends_before_it_connects() {
    let network = LocalNetwork::new();
    network.found(&[]);
    let output = network.join(1, &["--tensorboard", "/proc/nothing"]);
    let reported = logged(&output);
    assert_eq!(output.status.code(), Some(1), "{reported}");
    assert!(
        reported.contains("--tensorboard: ") && reported.contains("/proc/nothing"),
        "{reported}"
    );
    assert!(!Path::new(&network.path("state")).exists(), "{reported}");
}
