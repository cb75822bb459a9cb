//! A node is started while another one uses its state folder, for example by hand beside a unit of systemd. It must not touch what is there.

use super::refused::{founded, join, serve};
use crate::harness::process::Process;
use crate::harness::{as_in_the_runbook, fails, logs, words};
use std::fs;
use std::path::Path;

#[test]
fn a_second_node_on_a_state_folder_is_refused() {
    let network = founded(&["node", "other"]);
    let prover = network.prover();
    // No round opens without the other node, so this one stays.
    let aggregator = serve(&network, "127.0.0.1:0", &["--min-nodes", "2"]);
    let mut command = join(&network, "node", &aggregator.address(), &prover.address);
    let mut first = Process::start(&command);
    first.reports("committed to");
    let state = network.path("node-state");
    let written = Path::new(&state).join("update.unfinished");
    fs::write(&written, "half of it").unwrap();

    command.extend(["--rounds", "0"].map(str::to_owned));
    let reported = fails(&words(&command));
    assert!(
        reported.contains(&format!("another zk0 node uses {state}:")),
        "{reported}"
    );
    as_in_the_runbook(
        &reported,
        "stop it first, or choose another folder with --state",
    );
    assert!(written.exists(), "the first node still writes it");

    // The lock of a killed process does not stay.
    first.kill();
    logs(&words(&command));
    assert!(!written.exists());
}
