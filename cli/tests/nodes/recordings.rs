//! The rules `recordings`: a node whose recording is of another kind than the network's learns it before it registers.

use crate::harness::network::{committed, LocalNetwork};
use crate::harness::{logged, logs, prints, words, zk0, RECORDING};
use serde_json::{json, Value};
use std::fs;
use std::path::Path;
use zk0::keys;

/// The command that founds a network of one node whose recordings have to be like the fixture, except for `change`.
fn founding(network: &LocalNetwork, change: Value, more: &[&str]) -> Vec<String> {
    let rules = prints(&["aggregator", "rules", "--recordings-like", RECORDING]);
    let mut rules: Value = serde_json::from_str(&rules).unwrap();
    let changed = rules["recordings"].as_object_mut().unwrap();
    changed.extend(change.as_object().unwrap().clone());
    let file = network.path("rules.json");
    fs::write(&file, rules.to_string()).unwrap();
    let node = keys::generate(Path::new(&network.path("node.key"))).unwrap();
    let node = format!("node={node}");
    network.founding(&[&["--node", &node, "--rules", &file], more].concat())
}

fn found(network: &LocalNetwork, change: Value) {
    logs(&words(&founding(network, change, &[])));
}

#[test]
fn a_recording_of_another_kind_is_refused_before_it_is_registered() {
    let top = "observation.images.top";
    let wrist = "observation.images.wrist";
    let joints = ["main_gripper", "main_shoulder_pan"];
    let cases = [
        (json!({"fps": 50}), "it has 30 frames per second, not 50"),
        (
            json!({"joint_unit": "-100-to-100"}),
            "its joints are in degrees, not in -100 to 100 (",
        ),
        (json!({"joints": joints}), "the joints of its states are [\"main_shoulder_pan\", "),
        (json!({"joints": joints}), "the joints of its actions are [\"main_shoulder_pan\", "),
        (
            json!({"cameras": [top]}),
            "its cameras are {\"observation.images.top\", \"observation.images.wrist\"}, not {\"observation.images.top\"}",
        ),
        (
            json!({"cameras": [top, wrist, "observation.images.zoom"]}),
            "\"observation.images.wrist\"}, not {\"observation.images.top\", ",
        ),
    ];
    for (change, why) in cases {
        let network = LocalNetwork::new();
        found(&network, change);
        let output = network.join(0, &[]);
        let reported = logged(&output);
        assert_eq!(output.status.code(), Some(1), "{reported}");
        assert!(
            reported.contains("the recording is not like the others of this network"),
            "{reported}"
        );
        assert!(reported.contains(why), "{reported}");
        assert!(committed(&network.entries()).is_empty());
    }
}

#[test]
fn a_recording_of_the_network_s_kind_registers_and_a_map_gives_cameras_other_names() {
    let network = LocalNetwork::new();
    found(&network, json!({}));
    network.joins(0, &[]);
    assert_eq!(committed(&network.entries()).len(), 1);

    let network = LocalNetwork::new();
    let cameras = ["observation.images.front", "observation.images.wrist"];
    found(&network, json!({ "cameras": cameras }));
    let refused = logged(&network.join(0, &[]));
    assert!(
        refused.contains("(--rename-map gives cameras other names)"),
        "{refused}"
    );
    network.joins(0, &["--rename-map", r#"{"top": "front"}"#]);
    assert_eq!(committed(&network.entries()).len(), 1);
}

/// What the founder takes samples from has to be like the nodes' recordings.
#[test]
fn public_samples_of_another_kind_found_nothing() {
    for option in ["--public-recording", "--calibrate"] {
        let network = LocalNetwork::new();
        let founding = founding(&network, json!({"fps": 50}), &[option, RECORDING]);
        let output = zk0(&words(&founding)).output().unwrap();
        let reported = logged(&output);
        assert_eq!(output.status.code(), Some(1), "{reported}");
        assert!(
            reported.contains("it has 30 frames per second, not 50"),
            "{reported}"
        );
        assert!(!Path::new(&network.path("ledger")).exists());
    }
}

#[test]
fn a_node_that_only_registers_needs_no_proving_service() {
    let network = LocalNetwork::new();
    found(&network, json!({}));
    let (key, state) = (network.path("node.key"), network.path("state"));
    let output = network.served(|aggregator, _, id| {
        let nobody = ["--prover", "http://127.0.0.1:9", "--rounds", "0"];
        let mut join = zk0(&["node", "join", "--aggregator", aggregator, "--network", id]);
        join.args(["--key", &key, "--dataset", RECORDING, "--state", &state]);
        join.args(nobody).output().unwrap()
    });
    assert!(output.status.success(), "{}", logged(&output));
    assert_eq!(committed(&network.entries()).len(), 1);
}
