//! A node does not touch the folder of a release that keeps other files.

use crate::harness::network::LocalNetwork;
use crate::harness::{as_in_the_runbook, logged};
use std::fs;
use std::path::Path;

#[test]
fn a_folder_of_another_version_is_left_as_it_is() {
    let network = LocalNetwork::new();
    network.found(&[]);
    network.joins(0, &[]);
    let [version, left] = ["state/version", "state/update.unfinished"].map(|n| network.path(n));
    assert_eq!(fs::read_to_string(&version).unwrap(), "1");
    fs::write(&version, "2").unwrap();
    fs::write(&left, "half of it").unwrap();
    let output = network.join(0, &[]);
    let reported = logged(&output);
    assert_eq!(output.status.code(), Some(1), "{reported}");
    assert!(
        reported.contains(&format!("{version} names version \"2\"")),
        "{reported}"
    );
    as_in_the_runbook(
        &reported,
        "of a node's files, and this release reads version 1",
    );
    assert!(Path::new(&left).exists(), "it may be of the other release");
}
