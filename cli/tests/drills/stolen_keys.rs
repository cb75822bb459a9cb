//! A thief has the key of a node, of a governor, or of a server's certificate.

use super::{Operated, SHORT_VOTE};
use crate::harness::drill::Drill;
use crate::harness::serving::Serving;
use crate::harness::{fails, prints, LEDGER};
use std::fs;

/// The thief has moved the node to a key of its own, so the node cannot mend it.
#[test]
fn a_node_whose_key_is_stolen_gets_another_one() {
    let mut network = Operated::found(&["governor"], |_| {});
    let _aggregator = network.serves(&[]);
    let (thief, new) = (network.keygen("thief"), network.keygen("new"));
    for name in ["newer", "other"] {
        network.keygen(name);
    }
    network.succeeds("zk0 governance rotate-key $AT --key node.key --new-key thief.key");

    let mut drill = Drill::begin("a node's key is stolen");
    drill.shortened = Some(SHORT_VOTE);
    network.reader.fills_in("IDENTITY", thief.to_string());
    network.reader.fills_in("NEW", new.to_string());
    network.follows(&mut drill, "zk0 aggregator suspend $AT");
    let rotate = "zk0 governance rotate-key $AT --new-key other.key --key";
    let refused = network.fails(&format!("{rotate} thief.key"));
    assert!(refused.contains("suspended by the operator"), "{refused}");
    let propose = "zk0 governance propose $AT --key governor.key --title \"stolen\" replace-key";
    network.follows(&mut drill, propose);
    network.vote(&mut drill, &["governor"]);
    network.is_carried_out();
    network.follows(&mut drill, "zk0 aggregator reinstate $AT");
    for key in ["node", "thief"] {
        network.fails(&format!("{rotate} {key}.key"));
    }
    // The node has its place again.
    network.succeeds("zk0 governance rotate-key $AT --key new.key --new-key newer.key");
    drill.passed();
}

#[test]
fn a_governor_whose_key_is_stolen_is_removed_without_its_vote() {
    let network = Operated::found(&["governor", "other", "stolen"], |_| {});
    let _aggregator = network.serves(&[]);

    let mut drill = Drill::begin("a governor's key is stolen");
    drill.shortened = Some(SHORT_VOTE);
    network.votes_rules(&mut drill, &["governor", "other"], |rules| {
        let governors = rules["governance"]["governors"].as_array_mut().unwrap();
        governors.retain(|governor| governor["name"] != "stolen");
    });
    let no_vote = |ballot: &str| {
        let vote = format!("zk0 governance vote $AT --key stolen.key 0 {ballot}");
        let refused = network.fails(&vote);
        assert!(refused.contains("may not vote here"), "{refused}");
    };
    no_vote("against");
    network.is_carried_out();
    let propose = "zk0 governance propose $AT --key stolen.key --title mine rules rules.json";
    network.fails(propose);
    drill.passed();
}

#[test]
fn a_server_whose_tls_key_is_stolen_gets_another_authority() {
    let mut network = Operated::found(&["governor"], |_| {});
    network.reader.fills_in("HOST", "127.0.0.1");
    network.succeeds("zk0 aggregator certificate tls --name 127.0.0.1");
    let [certificate, key] = ["server.pem", "server.key"].map(|name| {
        let stolen = network.path(&format!("stolen.{name}"));
        let served = network.path(&format!("tls/{name}"));
        fs::copy(&served, &stolen).unwrap();
        [served, stolen]
    });
    let tls = |of: usize| ["--tls-certificate", &certificate[of], "--tls-key", &key[of]];
    let served = network.serves(&tls(0));
    // The thief shows a log of its own.
    let thief = ["ledger", "serve", LEDGER, "--listen", "127.0.0.1:0"];
    let thief = Serving::start(&[&thief[..], &tls(1)].concat());
    let thiefs = thief.address.replace("http://", "https://");
    let [old, new] = ["tls/ca.pem", "new/ca.pem"].map(|name| network.path(name));
    prints(&["ledger", "vkey", &thiefs, "--ca", &old]);

    let mut drill = Drill::begin("a TLS key is stolen");
    network.follows(&mut drill, "zk0 aggregator certificate new");
    network.follows(&mut drill, "cp new/server.pem new/server.key tls");
    served.logs("new connections are shown the new certificate");
    let refused = fails(&["ledger", "vkey", &thiefs, "--ca", &new]);
    assert!(refused.contains("is not signed by"), "{refused}");
    network.reader.fills_in("http://", "https://");
    network.succeeds("zk0 governance status $AT --ca new/ca.pem");
    let refused = network.fails("zk0 governance status $AT --ca tls/ca.pem");
    assert!(refused.contains("is not signed by"), "{refused}");
    drill.passed();
}
