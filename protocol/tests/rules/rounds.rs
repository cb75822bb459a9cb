//! Rounds open, take commitments and close.

use super::{refused, Breaks};
use crate::network::*;
use zk0_protocol::{Body, Refusal, RuleViolation, Signed, State};

#[test]
fn a_round_runs_from_opening_to_closing() {
    let mut chain = Chain::all_committed(2);
    chain.apply(accepted(&chain.state, 1));
    chain.apply(rejected(&chain.state, 0, invalid_proof()));
    let closing = closed(&chain.state, weights(0x50));
    assert_eq!(closing.contributors, [contributor(1, 20)]);
    chain.apply(Body::RoundClosed(closing));
    assert_eq!(chain.state.global(), &weights(0x50));
    assert_eq!(chain.state.round(), None);
    assert_eq!(chain.state.next_round(), 1);
    chain.open();
    assert_eq!(chain.state.round().unwrap().opened.base, weights(0x50));
}

#[test]
fn contributors_are_in_node_order_and_capped() {
    let mut chain = Chain::all_committed(12);
    for node in (0..12).rev() {
        chain.apply(accepted(&chain.state, node));
    }
    let contributors = chain.state.contributors();
    assert!(contributors.windows(2).all(|two| two[0].node < two[1].node));
    let of = |node| {
        contributors
            .iter()
            .find(|one| one.node == id(node))
            .unwrap()
            .samples
    };
    assert_eq!(
        (of(3), of(9), of(11)),
        (40, 100, 100),
        "the rules cap at 100"
    );
}

#[test]
fn rounds_open_one_after_the_other_from_the_global_weights() {
    let mut chain = Chain::new();
    let at = chain.time_ms;
    let right = opened(&chain.state, at + 1);
    let wrong: [Breaks<zk0_protocol::entries::entry::RoundOpened>; 6] = [
        ("round", |o| o.round = 1),
        ("base.blob", |o| o.base.blob = digest(0)),
        ("base.quantised", |o| o.base.quantised = digest(0)),
        ("evaluation", |o| o.evaluation = digest(0)),
        ("commit_deadline_ms", |o| o.commit_deadline_ms += 1),
        ("submit_deadline_ms", |o| o.submit_deadline_ms += 1),
    ];
    for (what, breaks) in wrong {
        let mut opened = right.clone();
        breaks(&mut opened);
        chain.time_ms = at;
        match chain.refusal(Body::RoundOpened(opened)) {
            RuleViolation::RoundField { field, .. } => assert_eq!(field, what),
            other => panic!("{what}: {other}"),
        }
    }
    chain.time_ms = at;
    chain.apply(Body::RoundOpened(right.clone()));
    assert_eq!(
        chain.refusal(Body::RoundOpened(right)),
        RuleViolation::RoundStillOpen(0)
    );
}

#[test]
fn deadlines_stay_within_time() {
    let mut chain = Chain::new();
    let right = opened(&chain.state, T0);
    chain.time_ms = u64::MAX - 10;
    assert_eq!(
        chain.refusal(Body::RoundOpened(right)),
        RuleViolation::EndOfTime(0)
    );
}

#[test]
fn updates_are_committed_in_the_open_round_by_whom_they_name() {
    let mut chain = Chain::new();
    chain.apply(enrolled(0));
    let body = committed(&chain.state, 0, weights(0x10));
    assert_eq!(
        refused(chain.refusal(body)),
        Refusal::WrongRound {
            claimed: 0,
            open: None
        }
    );
    let mut chain = Chain::in_round(2);
    let right = commitment(&chain.state, 0, weights(0x10));
    let sign = |statement, by| Body::UpdateCommitted(Signed::new(statement, &key(by)));
    assert!(matches!(
        refused(chain.refusal(sign(right.clone(), 1))),
        Refusal::Signature(_)
    ));
    let mut other = right.clone();
    other.network = digest(1);
    assert!(matches!(
        refused(chain.refusal(sign(other, 0))),
        Refusal::WrongNetwork { .. }
    ));
    let mut other = right.clone();
    other.round = 1;
    assert_eq!(
        refused(chain.refusal(sign(other, 0))),
        Refusal::WrongRound {
            claimed: 1,
            open: Some(0)
        }
    );
    let mut other = right.clone();
    other.dataset_root = dataset(1).root;
    assert!(
        matches!(refused(chain.refusal(sign(other, 0))), Refusal::Binding { field, .. } if field == "dataset_root")
    );
    let mut stranger = right.clone();
    stranger.node = id(5);
    assert_eq!(
        refused(chain.refusal(sign(stranger, 5))),
        Refusal::NotEnrolled(id(5))
    );
    chain.apply(enrolled(6));
    let mut empty = right.clone();
    empty.node = id(6);
    assert!(matches!(
        refused(chain.refusal(sign(empty, 6))),
        Refusal::Dataset(_)
    ));
    chain.apply(sign(right, 0));
    let again = committed(&chain.state, 0, weights(0x11));
    assert!(matches!(
        refused(chain.refusal(again)),
        Refusal::Duplicate { .. }
    ));
}

#[test]
fn updates_are_committed_before_the_deadline() {
    let mut chain = Chain::in_round(2);
    let deadline = chain.state.round().unwrap().opened.commit_deadline_ms;
    chain.time_ms = deadline;
    let body = committed(&chain.state, 0, weights(0x10));
    assert_eq!(
        refused(chain.refusal(body.clone())),
        Refusal::Late {
            what: "the commitment".into(),
            round: 0,
            late_ms: 1
        }
    );
    chain.time_ms = deadline - 1;
    chain.apply(body);
}

#[test]
fn an_update_counts_for_the_first_who_commits_it() {
    let mut chain = Chain::in_round(2);
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    let copy = committed(&chain.state, 1, weights(0x10));
    assert_eq!(
        refused(chain.refusal(copy)),
        Refusal::CopiedUpdate {
            update: weights(0x10).blob,
            by: id(0)
        }
    );
    // The other update has other bytes, but the same quantised numbers.
    let mut disguised = weights(0x11);
    disguised.quantised = weights(0x10).quantised;
    let disguised = committed(&chain.state, 1, disguised);
    assert!(matches!(
        refused(chain.refusal(disguised)),
        Refusal::CopiedUpdate { .. }
    ));
}

#[test]
fn a_copy_is_still_a_copy_in_the_next_round() {
    let mut chain = Chain::in_round(2);
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.time_ms += SUBMIT_WINDOW;
    chain.apply(Body::RoundClosed(closed(&chain.state, weights(4))));
    chain.open();
    let copy = committed(&chain.state, 1, weights(0x10));
    assert!(matches!(
        refused(chain.refusal(copy)),
        Refusal::CopiedUpdate { .. }
    ));
    chain.apply(committed(&chain.state, 0, weights(0x10)));
}

#[test]
fn the_challenge_depends_on_everything_that_fixes_it() {
    let mut chain = Chain::in_round(2);
    let body = committed(&chain.state, 0, weights(0x10));
    let challenge = |state: &State, node| state.expected_claim(&id(node)).unwrap().terms.challenge;
    let with_root = |byte| {
        let mut state = chain.state.clone();
        let at = entry(chain.time_ms, body.clone());
        state.apply(&digest(byte), &at).unwrap();
        challenge(&state, 0)
    };
    assert_eq!(with_root(1), with_root(1));
    assert_ne!(with_root(1), with_root(2));
    chain.apply(body);
    chain.apply(committed(&chain.state, 1, weights(0x11)));
    assert_ne!(challenge(&chain.state, 0), challenge(&chain.state, 1));
    let commit = &chain.state.round().unwrap().commits[&id(1)];
    let root = digest(commit.entry as u8);
    let network = chain.state.network();
    let expected =
        zk0_circuits::claim::challenge::challenge(network, 0, &id(1), commit.entry, &root);
    assert_eq!(commit.challenge, expected);
}

#[test]
fn a_round_waits_for_whoever_may_still_contribute() {
    let close = |chain: &Chain| Body::RoundClosed(closed(&chain.state, weights(4)));
    let early = |violation| matches!(violation, RuleViolation::ClosedEarly { .. });
    let mut chain = Chain::in_round(2);
    chain.apply(enrolled(2));
    // At first no node has committed. After that, one node has not committed yet.
    assert!(early(chain.refusal(close(&chain))));
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.apply(rejected(&chain.state, 0, invalid_proof()));
    assert!(early(chain.refusal(close(&chain))));
    assert!(!chain.state.may_close(chain.time_ms));
    // The time to commit is over, so nobody may commit any more.
    let mut waited = Chain {
        state: chain.state.clone(),
        time_ms: chain.state.round().unwrap().opened.commit_deadline_ms,
    };
    waited.apply(close(&waited));
    // All nodes have committed, and one contribution is undecided.
    chain.apply(committed(&chain.state, 1, weights(0x11)));
    assert!(early(chain.refusal(close(&chain))));
    let mut waited = Chain {
        state: chain.state.clone(),
        time_ms: chain.state.round().unwrap().opened.submit_deadline_ms,
    };
    waited.apply(close(&waited));
    chain.apply(rejected(&chain.state, 1, invalid_proof()));
    assert!(chain.state.may_close(chain.time_ms));
    chain.apply(close(&chain));
}

#[test]
fn a_closing_says_who_contributed_and_keeps_the_base_if_nobody_did() {
    let mut chain = Chain::all_committed(2);
    let not_open = Body::RoundClosed(zk0_protocol::entries::entry::RoundClosed {
        round: 1,
        ..closed(&chain.state, weights(4))
    });
    assert_eq!(chain.refusal(not_open), RuleViolation::RoundNotOpen(1));
    chain.apply(rejected(&chain.state, 0, invalid_proof()));
    let field = |violation| match violation {
        RuleViolation::RoundField { field, .. } => field,
        other => panic!("{other}"),
    };
    let mut nobody = Chain {
        state: chain.state.clone(),
        time_ms: chain.time_ms,
    };
    nobody.apply(rejected(&nobody.state, 1, invalid_proof()));
    let changed = Body::RoundClosed(closed(&nobody.state, weights(0x50)));
    assert_eq!(field(nobody.refusal(changed)), "global");
    nobody.apply(Body::RoundClosed(closed(&nobody.state, weights(4))));

    chain.apply(accepted(&chain.state, 1));
    let right = closed(&chain.state, weights(0x50));
    let wrong: [fn(&mut zk0_protocol::entries::entry::RoundClosed); 4] = [
        |c| c.contributors.clear(),
        |c| c.contributors[0].samples += 1,
        |c| c.contributors[0].node = id(0),
        |c| c.contributors.push(contributor(0, 10)),
    ];
    for breaks in wrong {
        let mut closed = right.clone();
        breaks(&mut closed);
        assert_eq!(
            field(chain.refusal(Body::RoundClosed(closed))),
            "contributors"
        );
    }
    chain.apply(Body::RoundClosed(right));
}
