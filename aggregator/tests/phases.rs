//! The phases of the rounds, and what is due in each: by the ledger's state and the time alone, without an aggregator.

use zk0_aggregator::round::phase::{due, is_overdue, phase, Due};
use zk0_aggregator::{Config, RoundStep};
use zk0_protocol::challenge::source::RandomnessSource;
use zk0_protocol::entries::proposal::Action;
use zk0_protocol::entries::signed::{Dispute, Evidence, Signed};
use zk0_protocol::rpc::federation::status_info::Phase;
use zk0_protocol::Body;
use zk0_testkit::network::beacon::Beacon;
use zk0_testkit::network::log_keys::*;
use zk0_testkit::network::votes::proposed;
use zk0_testkit::network::*;

const CONFIG: Config = Config {
    rounds: Some(1),
    min_nodes: 2,
};

/// The phase at this time, and what is due.
fn at(chain: &Chain, now_ms: u64) -> (Phase, Due) {
    let state = &chain.state;
    (phase(state, now_ms), due(state, &CONFIG, now_ms))
}

fn now(chain: &Chain) -> (Phase, Due) {
    at(chain, chain.time_ms)
}

/// The last moment that this phase, which has a deadline, may take.
fn last_moment(chain: &Chain) -> u64 {
    let round = chain.state.round().unwrap();
    let submit = round.randomness.map(|drawn| drawn.submit_deadline_ms);
    submit.unwrap_or(round.opened.commit_deadline_ms)
}

#[test]
fn a_round_waits_commits_draws_submits_and_closes() {
    let mut chain = Chain::new();
    assert_eq!(now(&chain), (Phase::Waiting, Due::Later(None)));
    for node in 0..2 {
        assert_eq!(now(&chain), (Phase::Waiting, Due::Later(None)));
        chain.apply(enrolled(node));
        chain.apply(registered(&chain.state.network().clone(), node));
    }
    let open = Due::Now(RoundStep::Open(0));
    assert_eq!(now(&chain), (Phase::Waiting, open));
    chain.open();
    let deadline = last_moment(&chain);
    let wait = Due::Later(Some(deadline + 1));
    let close = Due::Now(RoundStep::CloseCommitments(0));
    assert_eq!(now(&chain), (Phase::Committing, wait));
    assert_eq!(at(&chain, deadline), (Phase::Committing, wait));
    assert_eq!(at(&chain, deadline + 1), (Phase::Committing, close));
    for node in 0..2 {
        assert_eq!(now(&chain), (Phase::Committing, wait));
        chain.apply(committed(&chain.state, node, weights(0x10 + node)));
    }
    assert_eq!(now(&chain), (Phase::Committing, close));
    chain.close_commitments();
    let draw = Due::Now(RoundStep::Draw(0));
    assert_eq!(now(&chain), (Phase::Drawing, draw));
    let end = Due::Now(RoundStep::Close(0));
    let late = chain.time_ms + RANDOMNESS_WINDOW;
    assert_eq!(at(&chain, late), (Phase::Drawing, draw));
    assert_eq!(at(&chain, late + 1), (Phase::Closing, end));
    chain.apply(Body::RandomnessDrawn(drawn(&chain.state)));
    let deadline = last_moment(&chain);
    let wait = Due::Later(Some(deadline + 1));
    assert_eq!(at(&chain, deadline), (Phase::Submitting, wait));
    assert_eq!(at(&chain, deadline + 1), (Phase::Closing, end));
    for node in 0..2 {
        assert_eq!(now(&chain), (Phase::Submitting, wait));
        chain.apply(accepted(&chain.state, node));
    }
    assert_eq!(now(&chain), (Phase::Closing, end));
    chain.close(weights(0x50));
    // This was the only round.
    assert_eq!(now(&chain), (Phase::Waiting, Due::Later(None)));
}

#[test]
fn a_round_in_which_nobody_has_committed_takes_its_time() {
    let chain = Chain::in_round(0);
    let deadline = last_moment(&chain);
    let wait = Due::Later(Some(deadline + 1));
    assert_eq!(at(&chain, deadline), (Phase::Committing, wait));
    let close = Due::Now(RoundStep::CloseCommitments(0));
    assert_eq!(at(&chain, deadline + 1), (Phase::Committing, close));
}

#[test]
fn a_round_is_overdue_when_its_windows_are_long_over() {
    assert!(!is_overdue(&Chain::new().state, u64::MAX));
    for chain in [Chain::in_round(0), Chain::all_committed(2)] {
        let rules = chain.state.rules();
        let still_to_come = match &chain.state.round().unwrap().randomness {
            Some(_) => 0,
            None => rules.randomness_window_ms + rules.submit_window_ms,
        };
        let latest = last_moment(&chain) + still_to_come + rules.submit_window_ms.max(60_000);
        assert!(!is_overdue(&chain.state, latest));
        assert!(is_overdue(&chain.state, latest + 1));
    }
}

/// Its randomness is that of the former key, which may be lost.
#[test]
fn a_round_under_another_key_than_it_opened_with_ends_without_randomness() {
    let mut chain = Chain::in_round(1);
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.close_commitments();
    chain.apply(log_rotated_to(&chain.state, &later_key(1)));
    let closed_ms = chain.time_ms - 1;
    assert_eq!(now(&chain), (Phase::Drawing, Due::Later(None)));
    let end = Due::Now(RoundStep::Close(0));
    let late = closed_ms + RANDOMNESS_WINDOW + 1;
    assert_eq!(at(&chain, late), (Phase::Closing, end));
}

#[test]
fn a_beacon_is_due_when_its_time_has_come() {
    let beacons = Beacon::new(9).chain(T0 / 1000 - 1_000, 500);
    let mut founded = genesis();
    founded.rules.randomness = RandomnessSource::Drand(Box::new(beacons.clone()));
    founded.rules.randomness_window_ms = 60_000;
    let mut chain = Chain::founded(founded);
    chain.apply(enrolled(0));
    chain.apply(registered(&chain.state.network().clone(), 0));
    chain.open();
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.close_commitments();
    let begins_ms = beacons.time_ms(beacons.round_after(chain.time_ms));
    let wait = Due::Later(Some(begins_ms));
    assert_eq!(at(&chain, begins_ms - 1), (Phase::Drawing, wait));
    let draw = Due::Now(RoundStep::Draw(0));
    assert_eq!(at(&chain, begins_ms), (Phase::Drawing, draw));
}

#[test]
fn proposals_and_disputes_come_before_the_next_round() {
    let mut chain = Chain::all_committed(2);
    let contribution = chain.state.entries();
    for node in 0..2 {
        chain.apply(accepted(&chain.state, node));
    }
    chain.close(weights(0x50));
    chain.open();
    let disputed = chain.state.entries();
    let dispute = Dispute {
        network: *chain.state.network(),
        disputer: id(1),
        contribution,
        evidence: Evidence::Verification,
    };
    chain.apply(Body::Disputed(Signed::new(dispute, &key(1))));
    chain.apply(proposed(&chain.state, 0, Action::Suspend(id(1))));
    let over = chain.time_ms + VOTING + TIME_LOCK + 1;
    // They wait until the open round is over.
    let close = Due::Now(RoundStep::CloseCommitments(1));
    assert_eq!(at(&chain, over), (Phase::Committing, close));
    chain.close(weights(0x50));
    let resolve = Due::Now(RoundStep::Resolve(disputed));
    assert_eq!(now(&chain), (Phase::Waiting, resolve));
    let settle = Due::Now(RoundStep::Settle(0));
    assert_eq!(at(&chain, over), (Phase::Waiting, settle));
}
