//! Rules that ask for present nodes. Who is present is not on the ledger, but how many nodes there are is.

use zk0_protocol::rules::network_rules::Participation;
use zk0_protocol::rules::upper_bounds::MAX_COMMITS;
use zk0_protocol::{Body, RuleViolation, Rules};
use zk0_testkit::network::*;

fn present(min_nodes: u32, fraction_bps: u32) -> Participation {
    Participation::Present {
        min_nodes,
        fraction_bps,
    }
}

/// A network of these rules with `nodes` nodes that have datasets, and another one that has none.
fn network(participation: Participation, nodes: u8) -> Chain {
    let mut genesis = genesis();
    genesis.rules.participation = participation;
    let mut chain = Chain::founded(genesis);
    for node in 0..nodes {
        chain.apply(enrolled(node));
        chain.apply(registered(&chain.state.network().clone(), node));
    }
    chain.apply(enrolled(nodes));
    chain
}

#[test]
fn the_number_of_present_nodes_is_the_larger_of_minimum_and_fraction() {
    for (min_nodes, fraction_bps, nodes, least) in [
        (1, 0, 5, 1),
        (3, 0, 5, 3),
        (1, 5000, 5, 3),
        (1, 10_000, 5, 5),
        (2, 2500, 4, 2),
        (1, 2501, 4, 2),
        (3, 10_000, 1, 3),
    ] {
        let chain = network(present(min_nodes, fraction_bps), nodes);
        assert_eq!(chain.state.expected().count(), usize::from(nodes));
        assert_eq!(chain.state.least_present(), least);
    }
    assert_eq!(network(Participation::All, 2).state.least_present(), 0);
}

#[test]
fn a_round_does_not_open_with_fewer_nodes_than_have_to_be_present() {
    let mut chain = network(present(3, 0), 2);
    let opened = opened(&chain.state, chain.time_ms + 1);
    assert_eq!(
        chain.refusal(Body::RoundOpened(opened)),
        RuleViolation::TooFewNodes {
            round: 0,
            nodes: 2,
            least: 3
        }
    );
    chain.apply(registered(&chain.state.network().clone(), 2));
    chain.open();
    // Everybody may contribute, present or not.
    for node in 0..3 {
        chain.apply(committed(&chain.state, node, weights(0x10 + node)));
    }
}

#[test]
fn no_rule_asks_for_more_than_there_can_be() {
    let most = MAX_COMMITS as u32;
    let check = |participation| {
        let rules = Rules {
            participation,
            ..Rules::default()
        };
        rules.check()
    };
    check(present(most, 10_000)).unwrap();
    for (participation, words) in [
        (present(0, 0), "min_nodes 0; it has to be 1 to 1300"),
        (
            present(most + 1, 0),
            "min_nodes 1301; it has to be 1 to 1300",
        ),
        (
            present(1, 10_001),
            "fraction_bps 10001; it can be at most 10000",
        ),
    ] {
        let refused = check(participation).unwrap_err();
        assert!(refused.contains(words), "{refused}");
    }
}
