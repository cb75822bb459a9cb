//! A node leaves through a running aggregator, and may be enrolled again. The operator suspends and reinstates it.

use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{fails, logs, prints};
use std::path::Path;
use zk0::keys;
use zk0_protocol::Body;

#[test]
fn a_node_leaves_is_enrolled_again_and_suspended() {
    let network = LocalNetwork::new();
    network.found(&[]);
    let id = network.genesis().network_id().to_string();
    let [ledger, log_key, key] = ["ledger", "log.key", "node.key"].map(|name| network.path(name));
    let identity = keys::identity(&keys::read(Path::new(&key)).unwrap());
    let serve = ["aggregator", "serve", &ledger, "--key", &log_key];
    let serve = [&serve[..], &["--listen", "127.0.0.1:0"]].concat();
    let mut aggregator = Serving::start(&serve);
    let of = ["--aggregator", &aggregator.address, "--network", &id];
    let of: Vec<_> = of.map(str::to_owned).to_vec();
    let of: Vec<_> = of.iter().map(String::as_str).collect();
    let leave = [&["node", "leave", "--key", &key], &of[..]].concat();
    let node = format!("node={identity}");
    let enrol = ["aggregator", "enrol", "--key", &log_key, "--node", &node];
    let enrol = [&enrol[..], &of[..]].concat();

    assert_eq!(prints(&leave), "entry 2: the node has left\n");
    // Whoever has lost the answer asks again. A stranger cannot leave.
    assert_eq!(prints(&leave), "entry 2: the node has left\n");
    let stranger = network.path("stranger.key");
    keys::generate(Path::new(&stranger)).unwrap();
    let refused = fails(&[&["node", "leave", "--key", &stranger], &of[..]].concat());
    assert!(refused.contains("is not enrolled"), "{refused}");
    logs(&enrol);
    let identity_text = identity.to_string();
    let decide = |command| {
        let decide = ["aggregator", command, "--key", &log_key, &identity_text];
        prints(&[&decide[..], &of[..]].concat())
    };
    let suspended = format!("entry 4: node {identity} is suspended\n");
    assert_eq!(decide("suspend"), suspended);
    let refused = fails(&leave);
    assert!(refused.contains("suspended by the operator"), "{refused}");
    let reinstated = format!("entry 5: node {identity} is reinstated\n");
    assert_eq!(decide("reinstate"), reinstated);
    assert_eq!(prints(&leave), "entry 6: the node has left\n");
    assert!(aggregator.terminate().success());

    let left =
        |body: &Body| matches!(body, Body::NodeLeft(signed) if signed.statement.node == identity);
    let entries = network.entries();
    let places: Vec<_> = (0..entries.len())
        .filter(|at| left(&entries[*at].body))
        .collect();
    assert_eq!(places, [2, 6]);
}
