//! A commitment without a claim is recorded when its round closes, and a node with too many of them pauses.

use super::refused;
use zk0_protocol::challenge::unanswered::UnansweredRule;
use zk0_protocol::{Body, RefusalCode, RuleViolation};
use zk0_testkit::network::*;

/// One node besides node 0 always contributes, so that rounds go on while node 0 pauses.
fn network() -> Chain {
    let mut genesis = genesis();
    genesis.rules.unanswered = UnansweredRule {
        max: 1,
        of_last: 3,
        pause_rounds: 2,
    };
    let mut chain = Chain::founded(genesis);
    for node in 0..2 {
        chain.apply(enrolled(node));
        chain.apply(registered(&chain.state.network().clone(), node));
    }
    chain
}

/// Opens a round, in which both nodes commit and node 1 contributes.
fn committed_round(chain: &mut Chain) {
    chain.open();
    let number = 2 * chain.state.next_round() as u8;
    for node in 0..2 {
        chain.apply(committed(&chain.state, node, weights(0x10 + number + node)));
    }
    chain.draw();
    chain.apply(accepted(&chain.state, 1));
}

#[test]
fn a_closing_lists_who_committed_and_submitted_nothing() {
    let mut chain = network();
    committed_round(&mut chain);
    let deadline = chain.state.round().unwrap().randomness.unwrap();
    chain.time_ms = deadline.submit_deadline_ms;
    let right = closed(&chain.state, weights(0x50));
    assert_eq!(right.unanswered, [id(0)]);
    for wrong in [vec![], vec![id(1)], vec![id(0), id(1)], vec![id(0), id(0)]] {
        let mut closing = right.clone();
        closing.unanswered = wrong;
        chain.time_ms = deadline.submit_deadline_ms;
        assert!(matches!(
            chain.refusal(Body::RoundClosed(closing)),
            RuleViolation::RoundField {
                field: "unanswered",
                ..
            }
        ));
    }
    chain.time_ms = deadline.submit_deadline_ms;
    chain.apply(Body::RoundClosed(right));
}

/// A round whose commitments close as soon as the rules allow it after the commitments of these nodes. Returns whether that is before the deadline.
fn closes_early(chain: &mut Chain, committing: &[u8]) -> bool {
    chain.open();
    let number = 2 * chain.state.next_round() as u8;
    for node in committing {
        chain.apply(committed(
            &chain.state,
            *node,
            weights(0x10 + number + node),
        ));
    }
    let early = chain.state.next_commitments_closed(chain.time_ms + 1);
    chain.draw();
    for node in committing {
        chain.apply(accepted(&chain.state, *node));
    }
    chain.close(weights(0x50));
    early.is_some()
}

#[test]
fn a_node_that_was_idle_in_three_rounds_is_not_waited_for_until_it_commits() {
    let mut chain = network();
    for _ in 0..3 {
        assert!(!closes_early(&mut chain, &[1]));
    }
    assert!(closes_early(&mut chain, &[1]));
    // While nobody has committed, the round waits for everybody.
    chain.open();
    assert_eq!(chain.state.next_commitments_closed(chain.time_ms + 1), None);
    chain.close(*chain.state.global());
    // The node may still commit, and is waited for after that.
    assert!(closes_early(&mut chain, &[0, 1]));
    assert!(!closes_early(&mut chain, &[1]));
}

#[test]
fn a_refused_claim_was_answered_but_counts_as_none() {
    let mut chain = network();
    for _ in 0..2 {
        committed_round(&mut chain);
        chain.apply(rejected(&chain.state, 0, invalid_proof()));
        assert!(closed(&chain.state, weights(0x50)).unanswered.is_empty());
        chain.close(weights(0x50));
    }
    let record = chain.state.node(&id(0)).unwrap().record;
    assert_eq!(record.paused_until(2), Some(4));
    assert_eq!(record.paused_until(4), None);
}

#[test]
fn a_node_over_the_limit_pauses_and_nobody_waits_for_it() {
    let mut chain = network();
    for _ in 0..2 {
        committed_round(&mut chain);
        chain.close(weights(0x50));
    }
    for round in 2..4 {
        chain.open();
        let body = committed(&chain.state, 0, weights(0x40 + round));
        let paused = RefusalCode::Paused {
            node: id(0),
            until: 4,
        };
        assert_eq!(refused(chain.refusal(body)), paused);
        let open = chain.state.round().unwrap().clone();
        assert!(!chain.state.may_contribute(&open, &id(0)));
        chain.apply(committed(&chain.state, 1, weights(0x60 + round)));
        let now = chain.time_ms + 1;
        assert!(chain.state.next_commitments_closed(now).is_some());
        chain.draw();
        chain.apply(accepted(&chain.state, 1));
        chain.close(weights(0x50));
    }
    // The pause is over, and the record begins anew: one more failure is no reason for a pause.
    committed_round(&mut chain);
    chain.close(weights(0x50));
    committed_round(&mut chain);
}

#[test]
fn a_new_key_does_not_end_a_pause() {
    use zk0_protocol::entries::signed::{KeyRotation, KeyTakeover};
    use zk0_protocol::Signed;
    let mut chain = network();
    for _ in 0..2 {
        committed_round(&mut chain);
        chain.close(weights(0x50));
    }
    let rotation = KeyRotation {
        network: *chain.state.network(),
        node: id(0),
        with: id(9),
    };
    chain.apply(Body::KeyRotated {
        rotation: Signed::new(rotation, &key(0)),
        takeover: Signed::new(KeyTakeover { rotation }, &key(9)),
    });
    chain.open();
    let mut commitment = commitment(&chain.state, 0, weights(0x70));
    commitment.node = id(9);
    let body = Body::UpdateCommitted(Signed::new(commitment, &key(9)));
    assert!(matches!(
        refused(chain.refusal(body)),
        RefusalCode::Paused { until: 4, .. }
    ));
}
