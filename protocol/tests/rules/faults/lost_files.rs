//! A file of an accepted contribution is lost. The ledger records since when its node is asked for it, and the round closes without the
//! contribution only after as long as it takes submissions. The node gets no strike.

use zk0_protocol::challenge::unanswered::UnansweredRule;
use zk0_protocol::entries::entry::{LostContribution, MomentsComputed};
use zk0_protocol::rules::network_rules::Strategy;
use zk0_protocol::{Body, RuleViolation};
use zk0_testkit::network::*;

/// A network whose open round has accepted the contribution of node 0, and has a commitment of node 1. A node pauses after one
/// commitment without a claim.
fn accepted_one(strategy: Strategy) -> Chain {
    let mut genesis = genesis();
    genesis.rules.strategy = strategy;
    genesis.rules.unanswered = UnansweredRule {
        max: 0,
        of_last: 3,
        pause_rounds: 2,
    };
    let mut chain = Chain::founded(genesis);
    for node in 0..2 {
        chain.apply(enrolled(node));
        chain.apply(registered(&chain.state.network().clone(), node));
    }
    chain.open();
    for node in 0..2 {
        chain.apply(committed(&chain.state, node, weights(0x10 + node)));
    }
    chain.draw();
    chain.apply(accepted(&chain.state, 0));
    chain
}

fn of(round: u64, node: u8) -> LostContribution {
    let node = id(node);
    LostContribution { round, node }
}

#[test]
fn only_files_of_accepted_contributions_to_the_open_round_are_lost_and_once() {
    let mut chain = accepted_one(Strategy::FedAvg);
    let round = 0;
    for body in [Body::FilesLost, Body::ContributionLeftOut] {
        for node in [1, 2] {
            let refused = chain.refusal(body(of(round, node)));
            let node = id(node);
            assert_eq!(refused, RuleViolation::NotAccepted { round, node });
        }
        let refused = chain.refusal(body(of(1, 0)));
        assert_eq!(refused, RuleViolation::RoundNotOpen(1));
    }
    chain.apply(Body::FilesLost(of(round, 0)));
    let again = chain.refusal(Body::FilesLost(of(round, 0)));
    assert!(matches!(again, RuleViolation::Again { .. }), "{again}");
}

#[test]
fn a_contribution_is_left_out_after_its_node_was_asked_for_as_long_as_submissions_take() {
    let mut chain = accepted_one(Strategy::FedAvg);
    let (round, node) = (0, id(0));
    let left_out = || Body::ContributionLeftOut(of(round, 0));
    let window_ms = chain.state.rules().submit_window_ms;
    chain.time_ms += 10 * window_ms;
    let not_asked = chain.refusal(left_out());
    assert_eq!(not_asked, RuleViolation::NotAskedFor { round, node });
    chain.apply(Body::FilesLost(of(round, 0)));
    // The next entry comes a millisecond later.
    let asked_ms = chain.time_ms;
    chain.time_ms = asked_ms + window_ms - 1;
    let early = chain.refusal(left_out());
    let early_ms = 0;
    let expected = RuleViolation::LeftOutEarly {
        round,
        node,
        early_ms,
    };
    assert_eq!(early, expected);
    chain.time_ms = asked_ms + window_ms;
    let with = closed(&chain.state, weights(0x50));
    assert_eq!(with.contributors.len(), 1);
    chain.apply(left_out());
    let refused = chain.refusal(Body::RoundClosed(with));
    let field = "contributors";
    assert!(
        matches!(refused, RuleViolation::RoundField { field: found, .. } if found == field),
        "{refused}"
    );
    let without = closed(&chain.state, *chain.state.global());
    assert_eq!(
        (without.contributors.len(), &without.unanswered[..]),
        (0, &[id(1)][..])
    );
    chain.apply(Body::RoundClosed(without));
    // Who was left out goes on, and who has not answered pauses.
    let expected: Vec<_> = chain.state.expected().copied().collect();
    assert_eq!(expected, [node]);
    assert_eq!(chain.state.node(&node).unwrap().credits, 0);
    assert!(chain.state.contributions().is_empty());
}

#[test]
fn moments_that_were_computed_with_a_contribution_go_with_it() {
    let mut chain = accepted_one(Strategy::FedAdam {
        server_rate_billionths: 1_000_000,
        beta1_bps: 9000,
        beta2_bps: 9900,
        tau_billionths: 1_000_000,
    });
    chain.time_ms += 10 * chain.state.rules().submit_window_ms;
    let (round, moments) = (0, digest(0x30));
    chain.apply(Body::MomentsComputed(MomentsComputed { round, moments }));
    chain.apply(Body::FilesLost(of(round, 0)));
    chain.time_ms += chain.state.rules().submit_window_ms;
    chain.apply(Body::ContributionLeftOut(of(round, 0)));
    assert_eq!(chain.state.round().unwrap().moments, None);
}
