//! `zk0 aggregator init --node`: a network is founded with all of its first nodes, or not at all.

use crate::harness::network::LocalNetwork;
use crate::harness::{fails, logs, words};
use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use zk0::keys;

#[test]
fn a_node_that_cannot_be_enrolled_leaves_no_network_behind() {
    let network = LocalNetwork::new();
    let ledger = network.path("ledger");
    let node = keys::generate(Path::new(&network.path("node.key"))).unwrap();
    let [alice, bob, nameless] = ["alice", "bob", ""].map(|name| format!("{name}={node}"));
    let keyless = format!("carol={}", "0".repeat(64));
    for (other, why) in [
        (&bob, "enrolling bob: node "),
        (&bob, "is already enrolled"),
        (&keyless, "its identity is not an ed25519 public key"),
        (&nameless, "its name has 0 bytes"),
    ] {
        let nodes = ["--node", &alice, "--node", other];
        let refused = fails(&words(&network.founding(&nodes)));
        assert!(refused.contains(why), "{refused}");
        assert!(!Path::new(&ledger).exists(), "{other}");
    }
    let mut spaced = network.founding(&[]);
    let name = spaced.iter().position(|word| word == "--name").unwrap() + 1;
    spaced[name] = "my network".into();
    let refused = fails(&words(&spaced));
    assert!(refused.contains("cannot be a log's name"), "{refused}");
    assert!(!Path::new(&ledger).exists());
    // The corrected command founds the network.
    logs(&words(&network.founding(&["--node", &alice])));
    assert_eq!(network.entries().len(), 2);
}

#[test]
fn rules_that_ask_for_more_samples_than_an_argument_has_found_no_network() {
    let network = LocalNetwork::new();
    let rules = [
        "--mode",
        "succinct",
        "--min-dataset-samples",
        "200",
        "--min-eval-samples",
        "200",
    ];
    let refused = fails(&words(&network.founding(&rules)));
    let reports = "rule min_eval_samples is 200, and in mode succinct a claim about a policy of this size has at most ";
    assert!(refused.contains(reports), "{refused}");
    assert!(!Path::new(&network.path("ledger")).exists());
}

#[test]
fn a_file_in_place_of_the_folder_is_named() {
    let network = LocalNetwork::new();
    let file = network.path("ledger");
    fs::write(&file, "a file").unwrap();
    let mut below = network.founding(&[]);
    below[2] += "/below";
    for founding in [network.founding(&[]), below] {
        let refused = fails(&words(&founding));
        let reports = format!("{file} is a file, and a ledger needs a folder");
        assert!(refused.contains(&reports), "{refused}");
    }
    assert_eq!(fs::read_to_string(&file).unwrap(), "a file");
}

#[test]
fn a_key_that_others_can_read_is_warned_of_once() {
    let network = LocalNetwork::new();
    let key = network.path("log.key");
    let mend = format!("run `chmod 600 {key}`");
    fs::set_permissions(&key, Permissions::from_mode(0o644)).unwrap();
    let reported = logs(&words(&network.founding(&[])));
    assert_eq!(reported.matches(&mend).count(), 1, "{reported}");
    fs::set_permissions(&key, Permissions::from_mode(0o600)).unwrap();
    let reported = fails(&words(&network.founding(&[])));
    assert!(!reported.contains("chmod"), "{reported}");
}

#[test]
fn a_network_that_nobody_can_govern_is_founded_only_on_request() {
    let network = LocalNetwork::new();
    let forever = "--rules-never-change".to_owned();
    let mut founding = network.founding(&[]);
    assert_eq!(founding.pop(), Some(forever.clone()));
    let refused = fails(&words(&founding));
    assert!(refused.contains("--governor NAME=IDENTITY"), "{refused}");
    let governor = keys::generate(Path::new(&network.path("governor.key"))).unwrap();
    founding.extend(["--governor".to_owned(), format!("me={governor}")]);
    let both = [founding.clone(), vec![forever]].concat();
    let refused = fails(&words(&both));
    assert!(
        refused.contains("leave out --rules-never-change"),
        "{refused}"
    );
    assert!(!Path::new(&network.path("ledger")).exists());
    logs(&words(&founding));
    assert_eq!(network.genesis().rules.governance.governors.len(), 1);
}
