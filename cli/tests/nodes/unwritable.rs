//! A node needs only some of the files that it writes. Where it cannot write another one, because the disk is full or for another reason, it goes on.

use crate::harness::network::LocalNetwork;
use std::fs;
use std::path::Path;
use zk0_protocol::Body;

#[test]
fn files_that_only_people_read_cost_no_round() {
    let network = LocalNetwork::new();
    let claims = ["--min-eval-samples", "16", "--min-improvement-bps", "1"];
    let test = ["--confidence", "95%"];
    // Training takes a minute on a busy machine.
    let windows = ["--commit-minutes", "10", "--submit-minutes", "1"];
    network.found(&[&claims[..], &test, &windows].concat());
    let state = network.path("state");
    let state = Path::new(&state);
    // No file takes the place of a folder.
    for name in ["round-0.safetensors", "round-0.training.json"] {
        fs::create_dir_all(state.join(name)).unwrap();
    }
    let left = state.join("unfinished-update.00000000000000aa.unfinished");
    fs::write(&left, "half of it").unwrap();

    let training = ["--steps", "200", "--batch-size", "16"];
    let rate = ["--learning-rate", "5e-4"];
    let reported = network.joins(1, &[&training[..], &rate].concat());
    for lost in [
        "round 0: the update is not kept in the form that LeRobot reads: ",
        "round 0: the losses of the training are not kept: ",
    ] {
        assert!(reported.contains(lost), "{reported}");
    }
    let entries = network.entries();
    let committed = |body: &Body| matches!(body, Body::UpdateCommitted(_));
    let commitments = entries.iter().filter(|entry| committed(&entry.body));
    assert_eq!(commitments.count(), 1, "{reported}");
    assert!(!left.exists(), "what a killed node left takes no room");
}
