//! Governors: docs/governance.md.

use super::{network_of, Reader};
use std::fs;
use zk0::keys;

const PAGE: &str = "docs/governance.md";

#[test]
fn governors_found_a_network_and_vote_by_the_page() {
    let mut reader = Reader::new();
    keys::generate(&reader.path("log.key")).unwrap();
    let alice = reader.follows(PAGE, "zk0 governance keygen governor.key");
    reader.fills_in("alice=IDENTITY", format!("alice={}", alice.trim()));
    let bob = keys::generate(&reader.path("other.key")).unwrap();
    reader.fills_in("bob=IDENTITY", format!("bob={bob}"));
    reader.follows(PAGE, "zk0 aggregator rules");
    reader.follows(PAGE, "zk0 aggregator init ledger");
    let network = network_of(&reader.path("ledger"));

    reader.fills_in("0.0.0.0:7071", "127.0.0.1:0");
    let aggregator = reader.serves(
        "docs/operate.md",
        "zk0 aggregator serve ledger --key log.key --listen 0.0.0.0:7071 --min-nodes",
    );
    reader.fills_in(
        "$AT",
        format!("--aggregator {} --network {network}", aggregator.address),
    );
    reader.follows(PAGE, "zk0 governance status $AT");
    reader.follows(PAGE, "zk0 governance status $AT --rules");
    let rules = fs::read_to_string(reader.path("rules.json")).unwrap();
    let fewer = rules.replace("\"min_eval_samples\": 16", "\"min_eval_samples\": 15");
    assert_ne!(rules, fewer);
    fs::write(reader.path("rules.json"), fewer).unwrap();
    let propose = "zk0 governance propose $AT --key governor.key --title \"fewer";
    let proposed = reader.follows(PAGE, propose);
    assert!(proposed.contains("proposal 0"), "{proposed}");
    let voted = reader.follows(PAGE, "zk0 governance vote $AT");
    assert!(voted.contains("of 2"), "{voted}");
}
