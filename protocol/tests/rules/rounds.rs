//! Rounds open, take commitments and close.

use super::{refused, Breaks};
use zk0_protocol::entries::entry::RoundClosed;
use zk0_protocol::entries::refusal::claim_field::ClaimField;
use zk0_protocol::entries::refusal::code::RoundStatement;
use zk0_protocol::entries::signed::UpdateCommitment;
use zk0_protocol::{Body, RefusalCode, RuleViolation, Signed, State};
use zk0_testkit::network::*;

#[test]
fn a_round_runs_from_opening_to_closing() {
    let mut chain = Chain::all_committed(2);
    chain.apply(accepted(&chain.state, 1));
    chain.apply(rejected(&chain.state, 0, invalid_proof()));
    let closing = closed(&chain.state, weights(0x50));
    assert_eq!(closing.contributors, [contributor(1)]);
    chain.apply(Body::RoundClosed(closing));
    assert_eq!(chain.state.global(), &weights(0x50));
    assert_eq!(chain.state.round(), None);
    assert_eq!(chain.state.next_round(), 1);
    chain.open();
    assert_eq!(chain.state.round().unwrap().opened.base, weights(0x50));
}

#[test]
fn contributors_are_in_node_order() {
    let mut chain = Chain::all_committed(12);
    for node in (0..12).rev() {
        chain.apply(accepted(&chain.state, node));
    }
    let contributors = chain.state.contributors();
    assert!(contributors.windows(2).all(|two| two[0].node < two[1].node));
    assert_eq!(contributors.len(), 12);
}

#[test]
fn rounds_open_one_after_the_other_from_the_global_weights() {
    let mut chain = Chain::new();
    let at = chain.time_ms;
    let right = opened(&chain.state, at + 1);
    let wrong: [Breaks<zk0_protocol::entries::entry::RoundOpened>; 5] = [
        ("round", |o| o.round = 1),
        ("base.blob", |o| o.base.blob = digest(0)),
        ("base.quantised", |o| o.base.quantised = digest(0)),
        ("evaluation", |o| o.evaluation = digest(0)),
        ("commit_deadline_ms", |o| o.commit_deadline_ms += 1),
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
fn a_node_chooses_how_many_samples_are_evaluated_within_bounds() {
    let mut genesis = genesis();
    (
        genesis.rules.min_eval_samples,
        genesis.rules.max_eval_samples,
    ) = (4, 15);
    let mut chain = Chain::founded(genesis);
    let network = *chain.state.network();
    for node in 0..2 {
        chain.apply(enrolled(node));
        chain.apply(registered(&network, node));
    }
    chain.open();
    let asks = |state: &State, node: u8, eval_samples| {
        let commitment = UpdateCommitment {
            eval_samples,
            ..commitment(state, node, weights(0x10 + node))
        };
        Body::UpdateCommitted(Signed::new(commitment, &key(node)))
    };
    // The first node has 10 samples, the second 20.
    for (node, asked, most) in [
        (0, 0, 10),
        (0, 3, 10),
        (0, 11, 10),
        (1, 3, 15),
        (1, 16, 15),
        (1, u32::MAX, 15),
    ] {
        let least = 4;
        assert_eq!(
            refused(chain.refusal(asks(&chain.state, node, asked))),
            RefusalCode::EvalSamples { asked, least, most }
        );
    }
    chain.apply(asks(&chain.state, 0, 10));
    chain.apply(asks(&chain.state, 1, 15));
    chain.draw();
    for (node, chosen) in [(0, 10), (1, 15)] {
        let expected = chain.state.expected_claim(&id(node)).unwrap();
        assert_eq!(expected.terms.eval_samples, chosen);
        assert_eq!(expected.terms.test, chain.state.rules().test());
    }
}

#[test]
fn updates_are_committed_in_the_open_round_by_whom_they_name() {
    let mut chain = Chain::new();
    chain.apply(enrolled(0));
    let body = committed(&chain.state, 0, weights(0x10));
    assert_eq!(
        refused(chain.refusal(body)),
        RefusalCode::WrongRound {
            claimed: 0,
            open: None
        }
    );
    let mut chain = Chain::in_round(2);
    let right = commitment(&chain.state, 0, weights(0x10));
    let sign = |statement, by| Body::UpdateCommitted(Signed::new(statement, &key(by)));
    assert!(matches!(
        refused(chain.refusal(sign(right.clone(), 1))),
        RefusalCode::Signature
    ));
    let mut other = right.clone();
    other.network = digest(1);
    assert!(matches!(
        refused(chain.refusal(sign(other, 0))),
        RefusalCode::WrongNetwork { .. }
    ));
    let mut other = right.clone();
    other.round = 1;
    assert_eq!(
        refused(chain.refusal(sign(other, 0))),
        RefusalCode::WrongRound {
            claimed: 1,
            open: Some(0)
        }
    );
    let mut other = right.clone();
    other.dataset_root = dataset(1).root;
    assert_eq!(
        refused(chain.refusal(sign(other, 0))),
        RefusalCode::Binding(ClaimField::DatasetRoot)
    );
    let mut stranger = right.clone();
    stranger.node = id(5);
    assert_eq!(
        refused(chain.refusal(sign(stranger, 5))),
        RefusalCode::NotEnrolled(id(5))
    );
    chain.apply(enrolled(6));
    let mut empty = right.clone();
    empty.node = id(6);
    assert_eq!(
        refused(chain.refusal(sign(empty, 6))),
        RefusalCode::NoDataset(id(6))
    );
    chain.apply(sign(right, 0));
    let again = committed(&chain.state, 0, weights(0x11));
    assert!(matches!(
        refused(chain.refusal(again)),
        RefusalCode::Duplicate { .. }
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
        RefusalCode::Late {
            what: RoundStatement::Commitment,
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
        RefusalCode::CopiedUpdate {
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
        RefusalCode::CopiedUpdate { .. }
    ));
}

#[test]
fn a_copy_is_still_a_copy_in_the_next_round() {
    let mut chain = Chain::in_round(2);
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.close(weights(4));
    chain.open();
    let copy = committed(&chain.state, 1, weights(0x10));
    assert!(matches!(
        refused(chain.refusal(copy)),
        RefusalCode::CopiedUpdate { .. }
    ));
    chain.apply(committed(&chain.state, 0, weights(0x10)));
}

#[test]
fn a_round_waits_for_whoever_may_still_contribute() {
    let close = |chain: &Chain| Body::RoundClosed(closed(&chain.state, weights(4)));
    let early = |violation| matches!(violation, RuleViolation::ClosedEarly { .. });
    let mut chain = Chain::in_round(2);
    // The commitments are open, then they are closed, and then nobody has made a claim.
    assert!(early(chain.refusal(close(&chain))));
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.apply(committed(&chain.state, 1, weights(0x11)));
    assert!(early(chain.refusal(close(&chain))));
    chain.close_commitments();
    assert!(early(chain.refusal(close(&chain))));
    chain.apply(Body::RandomnessDrawn(drawn(&chain.state)));
    chain.apply(rejected(&chain.state, 0, invalid_proof()));
    // One contribution is undecided, and its deadline is not over.
    assert!(early(chain.refusal(close(&chain))));
    assert!(!chain.state.may_close(chain.time_ms));
    let randomness = chain.state.round().unwrap().randomness.unwrap();
    let mut waited = Chain {
        state: chain.state.clone(),
        time_ms: randomness.submit_deadline_ms - 1,
    };
    assert!(early(waited.refusal(close(&waited))));
    waited.apply(close(&waited));
    chain.apply(rejected(&chain.state, 1, invalid_proof()));
    assert!(chain.state.may_close(chain.time_ms));
    chain.apply(close(&chain));
}

#[test]
fn a_closing_says_who_contributed_and_keeps_the_base_if_nobody_did() {
    let mut chain = Chain::all_committed(2);
    let not_open = Body::RoundClosed(RoundClosed {
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
    let wrong: [fn(&mut RoundClosed); 5] = [
        |c| c.contributors.clear(),
        |c| c.contributors[0].share += 1,
        |c| c.contributors[0].credits += 1,
        |c| c.contributors[0].node = id(0),
        |c| c.contributors.push(contributor(0)),
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
