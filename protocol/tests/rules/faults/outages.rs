//! An outage moves the open round's deadlines by at most the silence that the ledger shows, and costs no node its standing.

use zk0_protocol::entries::entry::DeadlinesMoved;
use zk0_protocol::entries::proposal::{Action, Ballot};
use zk0_protocol::entries::signed::{OperatorDecision, Signed};
use zk0_protocol::rules::state::Node;
use zk0_protocol::rules::upper_bounds::MAX_ROUND_WINDOW_MS;
use zk0_protocol::{Body, RefusalCode, RuleViolation, State};
use zk0_testkit::network::log_keys::{later_key, log_rotated_to, public};
use zk0_testkit::network::votes::{proposed, voted};
use zk0_testkit::network::*;

const HOUR: u64 = 3_600_000;

fn moved(state: &State, by_ms: u64) -> Body {
    let round = state.round().map_or(0, |round| round.number());
    Body::DeadlinesMoved(DeadlinesMoved { round, by_ms })
}

fn commit_deadline_ms(chain: &Chain) -> u64 {
    chain.state.round().unwrap().opened.commit_deadline_ms
}

fn submit_deadline_ms(chain: &Chain) -> u64 {
    let round = chain.state.round().unwrap();
    round.randomness.unwrap().submit_deadline_ms
}

#[test]
fn the_deadline_of_the_present_phase_moves_by_the_outage() {
    let mut chain = Chain::in_round(2);
    let before = commit_deadline_ms(&chain);
    chain.time_ms += HOUR;
    chain.apply(moved(&chain.state, HOUR));
    assert_eq!(commit_deadline_ms(&chain), before + HOUR);
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.apply(committed(&chain.state, 1, weights(0x11)));
    chain.draw();
    let before = submit_deadline_ms(&chain);
    chain.time_ms += 2 * HOUR;
    assert!(chain.state.may_close(chain.time_ms));
    chain.apply(moved(&chain.state, 2 * HOUR));
    assert_eq!(submit_deadline_ms(&chain), before + 2 * HOUR);
    assert!(!chain.state.may_close(chain.time_ms));
    chain.apply(accepted(&chain.state, 0));
    chain.apply(accepted(&chain.state, 1));
    assert!(chain.state.may_close(chain.time_ms));
}

/// Nothing on the ledger lies in an outage, so an aggregator cannot stretch a round in which it works.
#[test]
fn a_deadline_moves_by_no_more_than_the_silence() {
    let mut chain = Chain::in_round(2);
    chain.time_ms += HOUR;
    for by_ms in [0, 2 * HOUR] {
        assert!(matches!(
            chain.refusal(moved(&chain.state, by_ms)),
            RuleViolation::MovedTooFar { .. }
        ));
    }
    chain.apply(moved(&chain.state, HOUR));
    // The same silence does not count twice.
    assert!(matches!(
        chain.refusal(moved(&chain.state, HOUR)),
        RuleViolation::MovedTooFar { .. }
    ));
}

/// A vote may be recorded while the witnesses are away, because it may name others.
#[test]
fn a_vote_in_an_outage_shortens_no_move() {
    let mut chain = Chain::in_round(2);
    let (before, begun) = (commit_deadline_ms(&chain), chain.time_ms);
    chain.time_ms += HOUR;
    chain.apply(proposed(&chain.state, 0, Action::Suspend(id(1))));
    chain.apply(voted(&chain.state, 0, 0, Ballot::For));
    chain.time_ms += HOUR;
    let away_ms = chain.time_ms - begun;
    chain.apply(moved(&chain.state, away_ms));
    assert_eq!(commit_deadline_ms(&chain), before + away_ms);
    // A node's entry ends the silence.
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.time_ms += HOUR;
    let refused = chain.refusal(moved(&chain.state, 2 * HOUR));
    assert!(matches!(refused, RuleViolation::MovedTooFar { .. }));
    // A deadline that has passed moves, although a vote came after it.
    let mut chain = Chain::in_round(2);
    let before = commit_deadline_ms(&chain);
    chain.time_ms = before + 1;
    chain.apply(proposed(&chain.state, 0, Action::Suspend(id(1))));
    chain.time_ms += 1;
    chain.apply(moved(&chain.state, 2));
    assert_eq!(commit_deadline_ms(&chain), before + 2);
}

/// A round with three nodes, in the first, second or third of its phases. Node 2 does not commit.
fn in_phase(phase: u8) -> Chain {
    let mut chain = Chain::in_round(3);
    if phase > 0 {
        chain.apply(committed(&chain.state, 0, weights(0x10)));
        chain.apply(committed(&chain.state, 1, weights(0x11)));
        chain.close_commitments();
    }
    if phase > 1 {
        chain.apply(Body::RandomnessDrawn(drawn(&chain.state)));
        chain.apply(accepted(&chain.state, 0));
    }
    chain
}

/// What the operator may record while no aggregator runs.
fn of_the_operator(state: &State) -> [Body; 3] {
    let decision = OperatorDecision {
        network: *state.network(),
        operator: public(&log_key()),
        node: id(2),
        suspended: true,
        number: state.next_decision(),
    };
    [
        log_rotated_to(state, &later_key(1)),
        enrolled(9),
        Body::OperatorDecided(Signed::new(decision, &log_key())),
    ]
}

/// By how much the deadline could move in the next entry.
fn longest_move_ms(chain: &mut Chain) -> u64 {
    let too_far = moved(&chain.state, u64::MAX);
    match chain.refusal(too_far) {
        RuleViolation::MovedTooFar { most_ms, .. } => most_ms,
        other => panic!("{other}"),
    }
}

/// A stolen key of the log is replaced while the aggregator is stopped. That costs no node its time, and gives nobody more of it.
#[test]
fn what_the_operator_records_in_an_outage_changes_no_move() {
    for (phase, recorded) in (0..3).flat_map(|phase| (0..3).map(move |recorded| (phase, recorded)))
    {
        let mut chain = in_phase(phase);
        let begun = chain.time_ms;
        chain.time_ms += HOUR;
        let body = of_the_operator(&chain.state)[recorded].clone();
        chain.apply(body);
        let longest_ms = longest_move_ms(&mut chain);
        assert_eq!(longest_ms, chain.time_ms - begun, "{phase} {recorded}");
        chain.apply(moved(&chain.state, longest_ms));
        match phase {
            0 => chain.apply(committed(&chain.state, 0, weights(0x10))),
            1 => chain.apply(Body::RandomnessDrawn(drawn(&chain.state))),
            _ => {
                let mut silent = chain.clone();
                silent.time_ms = submit_deadline_ms(&silent);
                let closed = closed(&silent.state, weights(0x50));
                silent.apply(Body::RoundClosed(closed));
                let rule = genesis().rules.unanswered;
                let record = &silent.state.node(&id(1)).unwrap().record;
                assert_eq!(record.failures(&rule), 0);
                chain.apply(accepted(&chain.state, 1));
                continue;
            }
        }
        // Who takes a node's work is not away, whatever the operator records.
        let worked = chain.time_ms;
        chain.time_ms += HOUR;
        chain.apply(enrolled(10));
        assert_eq!(longest_move_ms(&mut chain), chain.time_ms - worked);
    }
}

#[test]
fn all_outages_of_a_round_move_it_by_thirty_days_at_most() {
    let mut chain = Chain::in_round(2);
    chain.time_ms += MAX_ROUND_WINDOW_MS - HOUR;
    chain.apply(moved(&chain.state, MAX_ROUND_WINDOW_MS - HOUR));
    chain.time_ms += 2 * HOUR;
    let refused = chain.refusal(moved(&chain.state, 2 * HOUR));
    assert!(matches!(refused, RuleViolation::MovedTooFar { .. }));
    let next = chain.state.next_move(chain.time_ms, 2 * HOUR).unwrap();
    assert_eq!(next.by_ms, HOUR);
    chain.apply(Body::DeadlinesMoved(next));
}

#[test]
fn closed_commitments_stay_closed_and_a_decided_round_does_not_wait() {
    let mut chain = Chain::new();
    let number = chain.state.next_round();
    chain.time_ms += HOUR;
    let no_round = chain.refusal(moved(&chain.state, HOUR));
    assert_eq!(no_round, RuleViolation::RoundNotOpen(number));
    let mut chain = Chain::in_round(2);
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.close_commitments();
    let before = commit_deadline_ms(&chain);
    chain.time_ms += HOUR;
    chain.apply(moved(&chain.state, HOUR));
    assert_eq!(commit_deadline_ms(&chain), before);
    let late = chain.refusal(committed(&chain.state, 1, weights(0x11)));
    let round = chain.state.round().unwrap().number();
    assert_eq!(late, RefusalCode::CommitmentsClosed { round }.into());
    // The randomness may still come.
    chain.apply(Body::RandomnessDrawn(drawn(&chain.state)));
    chain.apply(accepted(&chain.state, 0));
    chain.time_ms += HOUR;
    let refused = chain.refusal(moved(&chain.state, HOUR));
    assert_eq!(refused, RuleViolation::NoDeadline(round));
}

#[test]
fn the_randomness_may_come_later_by_the_outage() {
    for outage in [false, true] {
        let mut chain = Chain::in_round(2);
        chain.apply(committed(&chain.state, 0, weights(0x10)));
        chain.close_commitments();
        chain.time_ms += RANDOMNESS_WINDOW + 1;
        if outage {
            chain.apply(moved(&chain.state, RANDOMNESS_WINDOW + 1));
            chain.apply(Body::RandomnessDrawn(drawn(&chain.state)));
        } else {
            let late = chain.refusal(Body::RandomnessDrawn(drawn(&chain.state)));
            assert!(matches!(late, RuleViolation::RandomnessLate { .. }));
        }
    }
}

/// A round with outages before the commitments closed and before the draw, or after the draw, which closes after its deadline. Node 0 has contributed, node 1 has
/// not answered, and node 2 has not committed. Returns the last two.
fn unanswered(early: bool, late: bool) -> (Node, Node) {
    let mut chain = Chain::in_round(3);
    let outage = |chain: &mut Chain| {
        chain.time_ms += HOUR;
        chain.apply(moved(&chain.state.clone(), HOUR));
    };
    if early {
        outage(&mut chain);
    }
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.apply(committed(&chain.state, 1, weights(0x11)));
    chain.close_commitments();
    if early {
        outage(&mut chain);
    }
    chain.apply(Body::RandomnessDrawn(drawn(&chain.state)));
    chain.apply(accepted(&chain.state, 0));
    if late {
        outage(&mut chain);
    }
    chain.time_ms = submit_deadline_ms(&chain);
    let closed = closed(&chain.state, weights(0x50));
    assert_eq!(closed.unanswered, [id(1)]);
    chain.apply(Body::RoundClosed(closed));
    let node = |node| chain.state.node(&id(node)).unwrap().clone();
    (node(1), node(2))
}

/// A node that knew before the draw that it need not answer would answer only what suits it.
#[test]
fn an_outage_excuses_what_it_kept_a_node_from() {
    let rule = genesis().rules.unanswered;
    let failures = |node: &Node| node.record.failures(&rule);
    let (silent, idle) = unanswered(false, false);
    assert_eq!(failures(&silent), 1);
    let (silent, away) = unanswered(true, false);
    assert_eq!(failures(&silent), 1);
    assert_ne!(away.record, idle.record, "who was away is not idle");
    let (excused, absent) = unanswered(false, true);
    assert_eq!(failures(&excused), 0);
    assert_eq!(absent.record, idle.record);
}

#[test]
fn a_short_outage_moves_nothing_unless_a_deadline_passed_in_it() {
    let mut chain = Chain::in_round(2);
    let round = chain.state.round().unwrap().number();
    chain.time_ms += COMMIT_WINDOW / 2;
    let short = chain.refusal(moved(&chain.state, COMMIT_WINDOW / 2));
    assert_eq!(short, RuleViolation::ShortOutage(round));
    chain.time_ms += COMMIT_WINDOW;
    chain.apply(moved(&chain.state, COMMIT_WINDOW));
    chain.apply(committed(&chain.state, 0, weights(0x10)));
}
