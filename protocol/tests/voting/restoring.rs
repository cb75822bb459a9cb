//! A vote goes back to the weights that an earlier round ended with.

use zk0_protocol::entries::entry::MomentsComputed;
use zk0_protocol::entries::proposal::impossible::Impossible;
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::rules::network_rules::Strategy;
use zk0_protocol::rules::round_results::REMEMBERED_RESULTS;
use zk0_protocol::{Body, RuleViolation};
use zk0_testkit::network::votes::*;
use zk0_testkit::network::*;

fn restore(round: u64) -> Action {
    Action::RestoreWeights { round }
}

trait RoundTo {
    /// Opens a round in which node 0 contributes, and closes it with these weights.
    fn round_to(&mut self, result: u8);
}

impl RoundTo for Chain {
    fn round_to(&mut self, result: u8) {
        self.open();
        let update = weights(0x10 + result);
        self.apply(committed(&self.state, 0, update));
        self.draw();
        self.apply(accepted(&self.state, 0));
        self.close(weights(result));
    }
}

fn with_a_node() -> Chain {
    let mut chain = Chain::new();
    chain.apply(enrolled(0));
    chain.apply(registered(&chain.state.network().clone(), 0));
    chain
}

#[test]
fn the_next_round_starts_from_the_restored_weights() {
    let mut chain = with_a_node();
    chain.round_to(1);
    chain.round_to(2);
    chain.decide(restore(0));
    assert_eq!(chain.state.global(), &weights(1));
    // An operator that goes on from the last weights all the same is refused.
    let mut opening = opened(&chain.state, chain.time_ms + 1);
    assert_eq!(opening.base, weights(1));
    opening.base = weights(2);
    assert!(matches!(
        chain.refusal(Body::RoundOpened(opening)),
        RuleViolation::RoundField {
            field: "base.blob",
            ..
        }
    ));
    chain.open();
    chain.close_commitments();
    // Nobody contributed, so the round ends with the weights that it started from.
    let other = closed(&chain.state, weights(2));
    assert!(matches!(
        chain.refusal(Body::RoundClosed(other)),
        RuleViolation::RoundField {
            field: "global",
            ..
        }
    ));
    chain.close(weights(1));
    // The rounds in between keep their results: a vote can go forward again.
    chain.decide(restore(1));
    assert_eq!(chain.state.global(), &weights(2));
    chain.decide(restore(2));
    assert_eq!(chain.state.global(), &weights(1));
}

#[test]
fn an_operator_cannot_start_from_earlier_weights_without_a_vote() {
    let mut chain = with_a_node();
    chain.round_to(1);
    chain.round_to(2);
    let mut opening = opened(&chain.state, chain.time_ms + 1);
    opening.base = weights(1);
    assert!(matches!(
        chain.refusal(Body::RoundOpened(opening)),
        RuleViolation::RoundField {
            field: "base.blob",
            ..
        }
    ));
}

/// A strategy with momentum goes on in the direction of the last round. The way to restored weights is no such direction.
#[test]
fn the_way_to_restored_weights_is_no_movement_of_a_round() {
    let mut chain = with_a_node();
    let initial = *chain.state.global();
    assert_eq!(chain.state.earlier_base(), None);
    chain.round_to(1);
    assert_eq!(chain.state.earlier_base(), Some(&initial));
    chain.round_to(2);
    assert_eq!(chain.state.earlier_base(), Some(&weights(1)));
    chain.decide(restore(0));
    assert_eq!(chain.state.earlier_base(), None);
    chain.open();
    assert_eq!(chain.state.earlier_base(), None);
    chain.close_commitments();
    chain.close(weights(1));
    assert_eq!(
        chain.state.earlier_base(),
        Some(&weights(1)),
        "a round that kept its base"
    );
    chain.round_to(3);
    assert_eq!(chain.state.earlier_base(), Some(&weights(1)));
}

/// Moments are of the way to the last weights, so they begin afresh where a vote restores others.
#[test]
fn restored_weights_have_no_moments() {
    let mut founded = genesis();
    founded.rules.strategy = Strategy::FedAdam {
        server_rate_billionths: 1_000_000,
        beta1_bps: 9000,
        beta2_bps: 9900,
        tau_billionths: 1_000_000,
    };
    let mut chain = Chain::founded(founded);
    chain.apply(enrolled(0));
    chain.apply(registered(&chain.state.network().clone(), 0));
    for round in 0..2 {
        chain.open();
        chain.apply(committed(&chain.state, 0, weights(0x10 + round)));
        chain.draw();
        chain.apply(accepted(&chain.state, 0));
        chain.apply(Body::MomentsComputed(MomentsComputed {
            round: round.into(),
            moments: digest(0x30 + round),
        }));
        chain.close(weights(0x50 + round));
    }
    assert_eq!(chain.state.moments().map(|moments| moments.steps), Some(2));
    let mut other = chain.state.rules().clone();
    let mut restored = chain.clone();
    restored.decide(restore(0));
    assert_eq!(restored.state.moments(), None);
    // Nor does another strategy keep them, once a round has closed by it.
    other.strategy = Strategy::FedAvg;
    chain.decide(Action::ChangeRules(Box::new(other)));
    chain.open();
    let base = *chain.state.global();
    chain.close(base);
    assert_eq!(chain.state.moments(), None);
}

#[test]
fn only_closed_rounds_can_be_restored() {
    let mut chain = with_a_node();
    let reports = |chain: &mut Chain, round: u64, reported: &str| {
        let proposal = proposed(&chain.state, 0, restore(round));
        match chain.refusal(proposal) {
            RuleViolation::BadProposal { why, .. } => assert_eq!(why, reported),
            other => panic!("{other}"),
        }
    };
    reports(&mut chain, 0, "there is no round 0 yet");
    chain.round_to(1);
    chain.open();
    reports(
        &mut chain,
        1,
        "round 1 is still open, so it has not ended with any weights",
    );
    reports(&mut chain, 2, "there is no round 2 yet");
    reports(
        &mut chain,
        u64::MAX,
        "there is no round 18446744073709551615 yet",
    );
    // The round and the ledger go on, and an earlier round can be restored while one is open.
    chain.apply(proposed(&chain.state, 0, restore(0)));
    chain.close(weights(1));
}

#[test]
fn rounds_are_forgotten_after_a_while_and_then_they_cannot_be_restored() {
    let too_long_ago =
        "round 0 is too long ago: the ledger remembers the weights of the last 4096 rounds";
    let mut chain = Chain::new();
    let empty_round = |chain: &mut Chain| {
        chain.open();
        let global = *chain.state.global();
        chain.close(global);
    };
    for _ in 0..REMEMBERED_RESULTS {
        empty_round(&mut chain);
    }
    chain.apply(proposed(&chain.state, 0, restore(0)));
    chain.apply(voted(&chain.state, 0, 0, Ballot::For));
    assert!(chain.state.results().of(0).is_some());
    empty_round(&mut chain);
    assert!(chain.state.results().of(0).is_none());
    assert!(chain.state.results().of(1).is_some());
    chain.wait(VOTING + TIME_LOCK);
    assert!(matches!(
        chain.refusal(settled(0, Outcome::Executed)),
        RuleViolation::OtherOutcome { .. }
    ));
    chain.apply(settled(
        0,
        Outcome::Impossible(Impossible::RoundForgotten(0)),
    ));
    match chain.refusal(proposed(&chain.state, 0, restore(0))) {
        RuleViolation::BadProposal { why, .. } => assert_eq!(why, too_long_ago),
        other => panic!("{other}"),
    }
    chain.open();
}
