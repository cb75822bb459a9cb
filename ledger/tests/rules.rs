//! Every rule of the state machine has a test that fails without it.

mod network;

use network::*;
use zk0_circuits::{Claim, Losses, NodeId};
use zk0_protocol::{
    entries::{codec::EntryError, member::NodeEnrolled},
    rules::network_rules::Disclosure,
    Body, Refusal, RuleViolation, Signed, State,
};

/// What is wrong, and how to make it so.
type Breaks<T> = (&'static str, fn(&mut T));

fn refused(violation: RuleViolation) -> Refusal {
    match violation {
        RuleViolation::Refused(refusal) => refusal,
        other => panic!("not a refusal: {other}"),
    }
}

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
fn genesis_comes_first_and_only_first() {
    assert_eq!(
        State::found(&entry(T0, enrolled(0))),
        Err(RuleViolation::NoGenesis)
    );
    assert_eq!(
        Chain::new().refusal(Body::Genesis(genesis())),
        RuleViolation::SecondGenesis
    );
}

#[test]
fn a_genesis_has_to_make_sense() {
    let broken: [Breaks<zk0_protocol::Genesis>; 15] = [
        ("evaluation", |g| g.evaluation[0] ^= 1),
        ("evaluation", |g| g.evaluation.push(0)),
        ("eval_samples", |g| g.rules.eval_samples = 11),
        ("eval_samples", |g| {
            g.rules.eval_samples = 5000;
            g.rules.min_dataset_samples = 5000;
        }),
        ("name", |g| g.name = "two words".into()),
        ("name", |g| g.name = "".into()),
        ("name", |g| g.name = "a+b".into()),
        ("name", |g| g.name = "n".repeat(129)),
        ("log_key", |g| g.log_key = [0; 32]),
        ("min_improvement_bps", |g| g.rules.min_improvement_bps = 0),
        ("min_improvement_bps", |g| {
            g.rules.min_improvement_bps = 10_001
        }),
        ("eval_samples", |g| g.rules.eval_samples = 0),
        ("min_dataset_samples", |g| g.rules.min_dataset_samples = 0),
        ("max_weight_samples", |g| g.rules.max_weight_samples = 0),
        ("submit_window_ms", |g| {
            g.rules.submit_window_ms = COMMIT_WINDOW - 1
        }),
    ];
    for (what, breaks) in broken {
        let mut genesis = genesis();
        breaks(&mut genesis);
        match State::found(&entry(T0, Body::Genesis(genesis))) {
            Err(RuleViolation::BadGenesis(why)) => assert!(why.contains(what), "{why}"),
            other => panic!("{what}: {other:?}"),
        }
    }
}

#[test]
fn the_network_id_is_that_of_the_whole_genesis() {
    let network = *Chain::new().state.network();
    let mut other = genesis();
    other.nonce[31] ^= 1;
    assert_ne!(network, other.network_id());
    let mut other = genesis();
    other.rules.max_proof_bytes += 1;
    assert_ne!(network, other.network_id());
}

#[test]
fn versions_are_known() {
    let mut unknown = entry(T0, Body::Genesis(genesis()));
    unknown.version = 2;
    let expected = RuleViolation::Entry(EntryError::UnknownVersion(2));
    assert_eq!(State::found(&unknown), Err(expected.clone()));
    let mut unknown = entry(T0, enrolled(0));
    unknown.version = 2;
    let mut state = Chain::new().state;
    assert_eq!(state.apply(&digest(0), &unknown), Err(expected));
}

#[test]
fn time_does_not_run_backwards() {
    let mut state = Chain::new().state;
    assert_eq!(
        state.apply(&digest(0), &entry(T0 - 1, enrolled(0))),
        Err(RuleViolation::TimeBackwards {
            time_ms: T0 - 1,
            last_ms: T0
        })
    );
    assert_eq!(state.apply(&digest(0), &entry(T0, enrolled(0))), Ok(()));
}

#[test]
fn nodes_enrol_once_under_a_real_key_and_a_plain_name() {
    let mut chain = Chain::new();
    chain.apply(enrolled(0));
    assert_eq!(
        chain.refusal(enrolled(0)),
        RuleViolation::AlreadyEnrolled(id(0))
    );
    let bad = |node: NodeId, name: &str| {
        Body::NodeEnrolled(NodeEnrolled {
            node,
            name: name.into(),
        })
    };
    // Zero is a point of small order: anyone can sign for it.
    for body in [
        bad(NodeId([0; 32]), "weak"),
        bad(id(1), ""),
        bad(id(1), "a\nb"),
        bad(id(1), &"n".repeat(129)),
    ] {
        assert!(matches!(chain.refusal(body), RuleViolation::BadNode { .. }));
    }
}

#[test]
fn datasets_are_signed_by_an_enrolled_node_of_this_network() {
    let mut chain = Chain::new();
    let network = *chain.state.network();
    assert_eq!(
        refused(chain.refusal(registered(&network, 0))),
        Refusal::NotEnrolled(id(0))
    );
    chain.apply(enrolled(0));
    let signed = Signed::new(registration(&network, 0), &key(1));
    assert!(matches!(
        refused(chain.refusal(Body::DatasetCommitted(signed))),
        Refusal::Signature(_)
    ));
    assert_eq!(
        refused(chain.refusal(registered(&digest(1), 0))),
        Refusal::WrongNetwork {
            claimed: digest(1),
            ours: network
        }
    );
    chain.apply(registered(&network, 0));
}

#[test]
fn datasets_are_large_enough_and_one_nodes_own() {
    let mut chain = Chain::new();
    let network = *chain.state.network();
    chain.apply(enrolled(0));
    chain.apply(enrolled(1));
    let mut small = registration(&network, 0);
    small.dataset.samples = 9;
    let small = Body::DatasetCommitted(Signed::new(small, &key(0)));
    assert!(
        matches!(refused(chain.refusal(small)), Refusal::Dataset(why) if why.contains("9 samples"))
    );

    chain.apply(registered(&network, 0));
    let mut copied = registration(&network, 1);
    copied.dataset.root = dataset(0).root;
    let copied = Body::DatasetCommitted(Signed::new(copied, &key(1)));
    assert!(matches!(
        refused(chain.refusal(copied.clone())),
        Refusal::Dataset(why) if why.contains("already registered")
    ));

    // A root that its owner has replaced is still its owner's.
    let mut replaced = registration(&network, 0);
    replaced.dataset.root = digest(0x77);
    chain.apply(Body::DatasetCommitted(Signed::new(replaced, &key(0))));
    assert_eq!(
        chain
            .state
            .node(&id(0))
            .unwrap()
            .dataset
            .unwrap()
            .commitment
            .root,
        digest(0x77)
    );
    assert!(matches!(
        refused(chain.refusal(copied)),
        Refusal::Dataset(_)
    ));
    // Nor can anybody send again what its owner signed for it, and so take the node back to it.
    assert!(matches!(
        refused(chain.refusal(registered(&network, 0))),
        Refusal::Dataset(why) if why.contains("under a new salt")
    ));
}

#[test]
fn datasets_do_not_change_under_an_open_round() {
    let mut chain = Chain::in_round(1);
    let network = *chain.state.network();
    assert_eq!(
        chain.refusal(registered(&network, 0)),
        RuleViolation::DatasetInUse {
            node: id(0),
            round: 0
        }
    );
}

#[test]
fn a_dataset_registered_after_the_opening_waits_for_the_next_round() {
    let mut chain = Chain::in_round(1);
    let network = *chain.state.network();
    chain.apply(enrolled(1));
    chain.apply(registered(&network, 1));
    assert!(matches!(
        refused(chain.refusal(committed(&chain.state, 1, weights(0x11)))),
        Refusal::Dataset(why) if why.contains("after round 0 opened")
    ));
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
    // Other bytes, the same numbers.
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
    let challenge = |state: &State, node| state.expected_claim(&id(node)).unwrap().challenge;
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
fn a_claim_says_what_the_ledger_fixed() {
    let wrong: [Breaks<Claim>; 17] = [
        ("version", |c| c.version -= 1),
        ("dataset.root", |c| c.dataset.root = digest(0)),
        ("dataset.samples", |c| c.dataset.samples += 1),
        ("dataset.feature_spec", |c| {
            c.dataset.feature_spec = digest(0)
        }),
        ("dataset.salt_commitment", |c| {
            c.dataset.salt_commitment = digest(0)
        }),
        ("evaluation", |c| c.evaluation = digest(0)),
        ("base.blob", |c| c.base.blob = digest(0)),
        ("base.quantised", |c| c.base.quantised = digest(0)),
        ("update.blob", |c| c.update.blob = digest(0)),
        ("update.quantised", |c| c.update.quantised = digest(0)),
        ("challenge", |c| c.challenge = digest(0)),
        ("eval_samples", |c| c.eval_samples -= 1),
        ("eval_samples", |c| c.eval_samples += 1),
        ("min_improvement_bps", |c| c.min_improvement_bps -= 1),
        ("min_improvement_bps", |c| c.min_improvement_bps += 1),
        ("disclosure", |c| c.losses = Losses::Hidden),
        ("dataset.samples", |c| c.dataset.samples = u64::MAX),
    ];
    let mut chain = Chain::all_committed(1);
    assert_eq!(chain.state.check_bindings(&claim(&chain.state, 0)), Ok(()));
    for (what, breaks) in wrong {
        let mut claim = claim(&chain.state, 0);
        breaks(&mut claim);
        let body = Body::ContributionAccepted(submission(claim, 0));
        match refused(chain.refusal(body)) {
            Refusal::Binding { field, .. } => assert_eq!(field, what),
            other => panic!("{what}: {other}"),
        }
    }
    chain.apply(accepted(&chain.state, 0));
}

#[test]
fn losses_stay_hidden_where_the_rules_say_so() {
    let mut genesis = genesis();
    genesis.rules.disclosure = Disclosure::Nothing;
    let mut chain = Chain::founded(genesis);
    let network = *chain.state.network();
    chain.apply(enrolled(0));
    chain.apply(registered(&network, 0));
    chain.open();
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    let mut claim = claim(&chain.state, 0);
    claim.losses = Losses::Disclosed {
        before: 2,
        after: 1,
        elements: 1,
    };
    let body = Body::ContributionAccepted(submission(claim, 0));
    assert!(
        matches!(refused(chain.refusal(body)), Refusal::Binding { field, .. } if field == "disclosure")
    );
    chain.apply(accepted(&chain.state, 0));
}

#[test]
fn a_claim_is_for_this_network_this_round_and_an_enrolled_node_that_committed() {
    let mut chain = Chain::in_round(2);
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    let right = claim(&chain.state, 0);
    let mut refusal = |breaks: fn(&mut Claim), by: u8| {
        let mut claim = right.clone();
        breaks(&mut claim);
        refused(chain.refusal(Body::ContributionAccepted(submission(claim, by))))
    };
    assert!(matches!(
        refusal(|c| c.network = digest(1), 0),
        Refusal::WrongNetwork { .. }
    ));
    assert!(matches!(
        refusal(|c| c.round = 1, 0),
        Refusal::WrongRound { .. }
    ));
    assert_eq!(refusal(|c| c.node = id(5), 5), Refusal::NotEnrolled(id(5)));
    assert_eq!(refusal(|c| c.node = id(1), 1), Refusal::NotCommitted(id(1)));
    assert!(matches!(refusal(|_| {}, 1), Refusal::Signature(_)));
}

#[test]
fn a_contribution_is_decided_once() {
    for first_accepted in [true, false] {
        let mut chain = Chain::all_committed(2);
        let (accept, reject) = (
            accepted(&chain.state, 0),
            rejected(&chain.state, 0, invalid_proof()),
        );
        chain.apply(if first_accepted {
            accept.clone()
        } else {
            reject.clone()
        });
        for second in [accept, reject] {
            assert!(matches!(
                refused(chain.refusal(second)),
                Refusal::Duplicate { .. }
            ));
        }
    }
}

#[test]
fn a_late_claim_is_refused_as_such() {
    let late = |late_ms| Refusal::Late {
        what: "the claim".into(),
        round: 0,
        late_ms,
    };
    let mut chain = Chain::all_committed(2);
    assert!(matches!(
        chain.refusal(rejected(&chain.state, 0, late(1))),
        RuleViolation::WrongReason { .. }
    ));
    let deadline = chain.state.round().unwrap().opened.submit_deadline_ms;
    chain.time_ms = deadline - 1;
    chain.apply(accepted(&chain.state, 1));
    assert_eq!(refused(chain.refusal(accepted(&chain.state, 0))), late(1));
    for wrong in [late(3), late(0)] {
        assert!(matches!(
            chain.refusal(rejected(&chain.state, 0, wrong)),
            RuleViolation::WrongReason { .. }
        ));
    }
    chain.apply(rejected(&chain.state, 0, late(1)));
}

#[test]
fn a_refusal_gives_the_reason_that_holds() {
    let mut chain = Chain::all_committed(1);
    let binding = |field: &str| Refusal::Binding {
        field: field.into(),
        claimed: "3".into(),
        expected: "2".into(),
    };
    // Nothing is wrong with this claim's bindings.
    assert!(matches!(
        chain.refusal(rejected(&chain.state, 0, binding("eval_samples"))),
        RuleViolation::WrongReason { .. }
    ));
    let mut wrong = claim(&chain.state, 0);
    wrong.eval_samples = 3;
    let reject = |reason| Body::ContributionRejected {
        submission: submission(wrong.clone(), 0),
        reason,
    };
    assert!(matches!(
        chain.refusal(reject(binding("challenge"))),
        RuleViolation::WrongReason { .. }
    ));
    assert!(matches!(
        chain.refusal(reject(Refusal::NotCommitted(id(0)))),
        RuleViolation::WrongReason { .. }
    ));
    chain.apply(reject(binding("eval_samples")));
}

#[test]
fn nobody_is_refused_by_a_strangers_hand_or_an_old_claim() {
    let mut chain = Chain::all_committed(2);
    let old = submission(claim(&chain.state, 0), 0);
    let forged = Body::ContributionRejected {
        submission: submission(claim(&chain.state, 0), 1),
        reason: invalid_proof(),
    };
    assert!(matches!(
        refused(chain.refusal(forged)),
        Refusal::Signature(_)
    ));
    chain.time_ms += SUBMIT_WINDOW;
    chain.apply(Body::RoundClosed(closed(&chain.state, weights(4))));
    chain.open();
    chain.apply(committed(&chain.state, 0, weights(0x12)));
    for reason in [
        invalid_proof(),
        Refusal::WrongRound {
            claimed: 0,
            open: Some(1),
        },
    ] {
        let replayed = Body::ContributionRejected {
            submission: old.clone(),
            reason,
        };
        assert!(matches!(
            refused(chain.refusal(replayed)),
            Refusal::WrongRound { .. }
        ));
    }
    let mut of_another = claim(&chain.state, 0);
    of_another.terms.node = id(1);
    let uncommitted = Body::ContributionRejected {
        submission: submission(of_another, 1),
        reason: invalid_proof(),
    };
    assert_eq!(
        refused(chain.refusal(uncommitted)),
        Refusal::NotCommitted(id(1))
    );
    chain.apply(accepted(&chain.state, 0));
}

#[test]
fn a_round_waits_for_whoever_may_still_contribute() {
    let close = |chain: &Chain| Body::RoundClosed(closed(&chain.state, weights(4)));
    let early = |violation| matches!(violation, RuleViolation::ClosedEarly { .. });
    let mut chain = Chain::in_round(2);
    chain.apply(enrolled(2));
    // Nobody has committed yet, then one has not.
    assert!(early(chain.refusal(close(&chain))));
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.apply(rejected(&chain.state, 0, invalid_proof()));
    assert!(early(chain.refusal(close(&chain))));
    assert!(!chain.state.may_close(chain.time_ms));
    // Nobody may commit any more.
    let mut waited = Chain {
        state: chain.state.clone(),
        time_ms: chain.state.round().unwrap().opened.commit_deadline_ms,
    };
    waited.apply(close(&waited));
    // All have committed, one is undecided.
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
