//! A node keeps everything when its key changes, or when it leaves and comes back, and an episode belongs to one node.

use ed25519_dalek::SigningKey;
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::entries::entry::DisputeResolved;
use zk0_protocol::entries::member::Standing;
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::entries::signed::{
    Dispute, Evidence, KeyRotation, KeyTakeover, Leaving, Proposal, Vote,
};
use zk0_protocol::rules::apply::MAX_ROTATIONS;
use zk0_protocol::rules::network_rules::Participation;
use zk0_protocol::{Body, Refusal, RefusalCode, RuleViolation, Signed, State};
use zk0_testkit::network::votes::*;
use zk0_testkit::network::*;

fn rotation(state: &State, node: u8, with: u8) -> KeyRotation {
    KeyRotation {
        network: *state.network(),
        node: id(node),
        with: id(with),
    }
}

fn rotated(state: &State, node: u8, with: u8) -> Body {
    let rotation = rotation(state, node, with);
    Body::KeyRotated {
        rotation: Signed::new(rotation, &key(node)),
        takeover: Signed::new(KeyTakeover { rotation }, &key(with)),
    }
}

/// With the identity element as key, this signature is valid for every text, unless signatures are verified strictly.
#[test]
fn nobody_moves_to_a_key_that_anyone_signs_for() {
    let mut chain = earned();
    let mut neutral = [0; 32];
    neutral[0] = 1;
    let rotation = KeyRotation {
        with: NodeId(neutral),
        ..rotation(&chain.state, 1, 9)
    };
    let mut signature = [0; 64];
    signature[..32].copy_from_slice(&neutral);
    let takeover = Signed {
        statement: KeyTakeover { rotation },
        signature,
    };
    let rotated = Body::KeyRotated {
        rotation: Signed::new(rotation, &key(1)),
        takeover,
    };
    assert!(matches!(
        chain.refusal(rotated),
        RuleViolation::Refused(Refusal {
            code: RefusalCode::Signature,
            ..
        })
    ));
}

fn earned() -> Chain {
    let mut chain = Chain::all_committed(2);
    chain.apply(accepted(&chain.state, 1));
    chain.apply(rejected(&chain.state, 0, invalid_proof()));
    chain.apply(Body::RoundClosed(closed(&chain.state, weights(0x50))));
    chain
}

#[test]
fn a_node_keeps_its_place_under_another_key() {
    let mut chain = earned();
    let before = chain.state.node(&id(1)).unwrap().clone();
    chain.apply(rotated(&chain.state, 1, 9));
    assert_eq!(chain.state.node(&id(9)), Some(&before));
    assert_eq!(chain.state.node(&id(1)), None);
    let network = *chain.state.network();
    // The data and the updates still belong to this node, and to nobody else.
    let mut again = registration(&network, 1);
    again.node = id(9);
    chain.apply(Body::DatasetCommitted(Signed::new(again, &key(9))));
    chain.open();
    let mut commitment = commitment(&chain.state, 1, weights(0x11));
    commitment.node = id(9);
    let mut copied = commitment.clone();
    (copied.node, copied.dataset_root) = (id(0), dataset(0).root);
    let copied = Body::UpdateCommitted(Signed::new(copied, &key(0)));
    assert!(matches!(
        chain.refusal(copied),
        RuleViolation::Refused(Refusal {
            code: RefusalCode::CopiedUpdate { .. },
            ..
        })
    ));
    chain.apply(Body::UpdateCommitted(Signed::new(commitment, &key(9))));
    // The old key no longer belongs to any node.
    let old = committed(&chain.state, 1, weights(0x40));
    assert_eq!(chain.refusal(old), RefusalCode::NotEnrolled(id(1)).into());
    assert_eq!(
        chain.refusal(enrolled(1)),
        RuleViolation::AlreadyEnrolled(id(1))
    );
    assert_eq!(
        chain.refusal(rotated(&chain.state, 0, 1)),
        RuleViolation::AlreadyEnrolled(id(1)),
        "a key that was used is not used again"
    );
}

#[test]
fn both_keys_sign_and_neither_is_taken() {
    let mut chain = earned();
    let this = rotation(&chain.state, 1, 9);
    let other = rotation(&chain.state, 1, 8);
    let body = |rotation: KeyRotation, by: u8, taken: KeyRotation, taken_by: u8| Body::KeyRotated {
        rotation: Signed::new(rotation, &key(by)),
        takeover: Signed::new(KeyTakeover { rotation: taken }, &key(taken_by)),
    };
    for forged in [
        body(this, 9, this, 9),
        body(this, 1, this, 1),
        body(this, 0, this, 9),
    ] {
        assert!(matches!(
            chain.refusal(forged),
            RuleViolation::Refused(Refusal {
                code: RefusalCode::Signature,
                ..
            })
        ));
    }
    assert_eq!(
        chain.refusal(body(this, 1, other, 8)),
        RuleViolation::OtherTakeover(id(1))
    );
    assert_eq!(
        chain.refusal(rotated(&chain.state, 1, 0)),
        RuleViolation::AlreadyEnrolled(id(0))
    );
    assert_eq!(
        chain.refusal(rotated(&chain.state, 7, 9)),
        RefusalCode::NotEnrolled(id(7)).into()
    );
    let mut founded = genesis();
    founded.nonce[0] ^= 1;
    let elsewhere = rotated(&Chain::founded(founded).state, 1, 9);
    assert!(matches!(
        chain.refusal(elsewhere),
        RuleViolation::Refused(Refusal {
            code: RefusalCode::WrongNetwork { .. },
            ..
        })
    ));
    chain.decide(Action::Suspend(id(1)));
    assert!(matches!(
        chain.refusal(rotated(&chain.state, 1, 9)),
        RuleViolation::Refused(Refusal {
            code: RefusalCode::NotActive { .. },
            ..
        })
    ));
}

#[test]
fn a_key_stays_while_its_update_is_in_the_round() {
    let mut chain = Chain::in_round(2);
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    assert_eq!(
        chain.refusal(rotated(&chain.state, 0, 9)),
        RuleViolation::KeyInUse {
            node: id(0),
            round: 0
        }
    );
    chain.apply(rotated(&chain.state, 1, 9));
}

#[test]
fn a_lost_key_is_replaced_by_vote() {
    let mut chain = earned();
    let before = chain.state.node(&id(1)).unwrap().clone();
    chain.decide(Action::ReplaceKey {
        node: id(1),
        with: id(9),
    });
    assert_eq!(chain.state.node(&id(9)), Some(&before));
}

#[test]
fn votes_and_places_in_a_sample_go_with_the_key() {
    let mut founded = genesis();
    founded.rules.participation = Participation::Sampled { nodes: 5 };
    let mut chain = Chain::founded(founded);
    for node in 0..2 {
        chain.apply(enrolled(node));
        chain.apply(registered(&chain.state.network().clone(), node));
    }
    chain.open();
    chain.apply(committed(&chain.state, 1, weights(0x11)));
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.draw();
    chain.apply(accepted(&chain.state, 1));
    chain.apply(rejected(&chain.state, 0, invalid_proof()));
    chain.apply(Body::RoundClosed(closed(&chain.state, weights(0x50))));
    chain.open();
    let change = Action::Suspend(id(0));
    chain.apply(Body::Proposed(Signed::new(
        Proposal {
            proposer: id(1),
            ..proposal(&chain.state, 0, change)
        },
        &key(1),
    )));
    chain.apply(rotated(&chain.state, 1, 9));
    let vote = |voter: u8| {
        let vote = Vote {
            network: *chain.state.network(),
            proposal: 0,
            of: digest_of(&chain.state, 0),
            voter: id(voter),
            ballot: Ballot::For,
        };
        Body::Voted(Signed::new(vote, &key(voter)))
    };
    let (old, new) = (vote(1), vote(9));
    assert_eq!(chain.refusal(old), RuleViolation::NoVote(id(1)));
    chain.apply(new);
    assert_eq!(chain.state.proposals()[&0].tally().for_it, 5);
    let mut commitment = commitment(&chain.state, 1, weights(0x33));
    commitment.node = id(9);
    chain.apply(Body::UpdateCommitted(Signed::new(commitment, &key(9))));
}

#[test]
fn nobody_gets_away_by_changing_keys() {
    let mut chain = earned();
    chain.apply(proposed(&chain.state, 0, Action::Suspend(id(1))));
    for governor in 0..3 {
        chain.apply(voted(&chain.state, governor, 0, Ballot::For));
    }
    chain.apply(rotated(&chain.state, 1, 9));
    chain.wait(VOTING + TIME_LOCK);
    chain.apply(settled(0, Outcome::Executed));
    assert_eq!(
        chain.state.node(&id(9)).unwrap().standing,
        Standing::Suspended
    );
    // Each node may have one open dispute, even if its key changes.
    let mut chain = Chain::all_committed(3);
    let contributions = [0, 1].map(|node| {
        chain.apply(accepted(&chain.state, node));
        chain.state.entries() - 1
    });
    chain.apply(rejected(&chain.state, 2, invalid_proof()));
    chain.apply(Body::RoundClosed(closed(&chain.state, weights(0x50))));
    let disputed = |state: &State, by: u8, contribution: u64| {
        let dispute = Dispute {
            network: *state.network(),
            disputer: id(by),
            contribution,
            evidence: Evidence::Verification,
        };
        Body::Disputed(Signed::new(dispute, &key(by)))
    };
    chain.apply(disputed(&chain.state, 2, contributions[0]));
    chain.apply(rotated(&chain.state, 2, 9));
    let refused = chain.refusal(disputed(&chain.state, 9, contributions[1]));
    assert!(
        matches!(refused, RuleViolation::BadDispute { .. }),
        "{refused}"
    );
}

/// One look-up finds whose a former key is, however often the key has changed. A node can change its key only so often.
#[test]
fn a_node_changes_its_key_a_hundred_times_at_most() {
    let mut chain = earned();
    let key = |turn: u8| match turn {
        0 => key(1),
        turn => {
            let mut seed = [3; 32];
            seed[0] = turn;
            SigningKey::from_bytes(&seed)
        }
    };
    let id = |turn| NodeId(key(turn).verifying_key().to_bytes());
    let rotated = |state: &State, from: u8| {
        let rotation = KeyRotation {
            network: *state.network(),
            node: id(from),
            with: id(from + 1),
        };
        Body::KeyRotated {
            rotation: Signed::new(rotation, &key(from)),
            takeover: Signed::new(KeyTakeover { rotation }, &key(from + 1)),
        }
    };
    for turn in 0..100 {
        chain.apply(rotated(&chain.state, turn));
    }
    let limit = MAX_ROTATIONS;
    let node = id(100);
    let refused = chain.refusal(rotated(&chain.state, 100));
    assert_eq!(refused, RuleViolation::TooManyKeys { node, limit });
    // The dataset that the node registered under its first key still belongs to it.
    let network = *chain.state.network();
    let mut again = registration(&network, 1);
    again.node = node;
    chain.apply(Body::DatasetCommitted(Signed::new(again, &key(100))));
    // A vote can still give the node another key.
    let with = self::id(9);
    chain.decide(Action::ReplaceKey { node, with });
    assert_eq!(chain.state.node(&with).unwrap().credits, 100);
}

#[test]
fn an_episode_is_one_nodes_own() {
    let mut chain = Chain::new();
    let network = *chain.state.network();
    chain.apply(enrolled(0));
    chain.apply(enrolled(1));
    chain.apply(registered(&network, 0));
    let with = |node: u8, episodes: Vec<Digest>| {
        let mut registration = registration(&network, node);
        registration.episodes = episodes.into_iter().map(episode).collect();
        Body::DatasetCommitted(Signed::new(registration, &key(node)))
    };
    let reported = |refusal: RuleViolation| refusal.to_string();
    let theirs = registration(&network, 0).episodes;
    let mixed = vec![digest(1), theirs[1].digest];
    assert!(reported(chain.refusal(with(1, mixed.clone()))).contains("already registered by node"));
    for (episodes, why) in [
        (vec![], "0 episodes"),
        (vec![digest(2), digest(1)], "ascending"),
        (vec![digest(1), digest(1)], "twice"),
        (
            (0..=1500u16)
                .map(|number| {
                    let mut digest = digest(0);
                    digest.0[..2].copy_from_slice(&number.to_be_bytes());
                    digest
                })
                .collect(),
            "1501 episodes",
        ),
    ] {
        let found = reported(chain.refusal(with(1, episodes)));
        assert!(found.contains(why), "{found}");
    }
    // The node may register its own episode again. An episode that it has replaced still belongs to it.
    chain.apply(with(0, vec![digest(9)]));
    assert!(reported(chain.refusal(with(1, mixed))).contains("already registered"));
    chain.apply(with(1, vec![digest(1)]));
}

fn leaving(state: &State, node: u8) -> Leaving {
    Leaving {
        network: *state.network(),
        node: id(node),
        round: state.next_round(),
    }
}

fn left(state: &State, node: u8) -> Body {
    Body::NodeLeft(Signed::new(leaving(state, node), &key(node)))
}

#[test]
fn a_node_that_has_left_takes_part_again_once_it_is_enrolled_again() {
    let mut chain = earned();
    let before = chain.state.node(&id(1)).unwrap().clone();
    chain.apply(left(&chain.state, 1));
    assert_eq!(chain.state.node(&id(1)).unwrap().standing, Standing::Left);
    // It has no votes, is not waited for, and signs nothing more.
    assert!(!chain.state.electorate().contains_key(&id(1)));
    assert_eq!(chain.state.expected().collect::<Vec<_>>(), [&id(0)]);
    let gone = |violation: RuleViolation| match violation {
        RuleViolation::Refused(Refusal {
            code: RefusalCode::NotActive { standing, .. },
            ..
        }) => standing,
        other => panic!("{other}"),
    };
    let again = chain.refusal(left(&chain.state, 1));
    assert_eq!(gone(again), Standing::Left);
    chain.open();
    let commitment = committed(&chain.state, 1, weights(0x12));
    assert_eq!(gone(chain.refusal(commitment)), Standing::Left);
    chain.apply(committed(&chain.state, 0, weights(0x13)));
    chain.draw();
    chain.apply(accepted(&chain.state, 0));
    chain.apply(Body::RoundClosed(closed(&chain.state, weights(0x51))));
    chain.apply(enrolled(1));
    assert_eq!(chain.state.node(&id(1)), Some(&before));
    assert_eq!(
        chain.refusal(enrolled(1)),
        RuleViolation::AlreadyEnrolled(id(1))
    );
    chain.open();
    chain.apply(committed(&chain.state, 1, weights(0x14)));
}

#[test]
fn a_node_leaves_by_its_own_wish_of_this_time() {
    let mut chain = earned();
    let forged = Body::NodeLeft(Signed::new(leaving(&chain.state, 1), &key(0)));
    assert!(matches!(
        chain.refusal(forged),
        RuleViolation::Refused(Refusal {
            code: RefusalCode::Signature,
            ..
        })
    ));
    let elsewhere = Leaving {
        network: digest(1),
        ..leaving(&chain.state, 1)
    };
    let elsewhere = Body::NodeLeft(Signed::new(elsewhere, &key(1)));
    assert!(matches!(
        chain.refusal(elsewhere),
        RuleViolation::Refused(Refusal {
            code: RefusalCode::WrongNetwork { .. },
            ..
        })
    ));
    // Once it was enrolled again and a round has opened, the old statement does not count.
    let old = left(&chain.state, 1);
    chain.apply(old.clone());
    chain.apply(enrolled(1));
    chain.open();
    assert_eq!(
        chain.refusal(old),
        RuleViolation::OtherLeaving {
            node: id(1),
            round: 1,
            next: 2
        }
    );
    chain.apply(committed(&chain.state, 1, weights(0x12)));
    assert_eq!(
        chain.refusal(left(&chain.state, 1)),
        RuleViolation::LeavesRound {
            node: id(1),
            round: 1
        }
    );
    // Whoever has not committed leaves, and the round does not wait for it.
    chain.apply(left(&chain.state, 0));
    let now = chain.time_ms + 1;
    assert!(chain.state.next_commitments_closed(now).is_some());
}

#[test]
fn nobody_escapes_a_judgement_by_leaving() {
    let mut chain = earned();
    let accepted = *chain.state.contributions().keys().next().unwrap();
    let dispute = Dispute {
        network: *chain.state.network(),
        disputer: id(0),
        contribution: accepted,
        evidence: Evidence::Verification,
    };
    let raised = chain.state.entries();
    chain.apply(Body::Disputed(Signed::new(dispute, &key(0))));
    chain.apply(left(&chain.state, 1));
    let resolved = DisputeResolved {
        dispute: raised,
        upheld: Some(invalid_proof()),
    };
    chain.apply(Body::DisputeResolved(resolved));
    assert_eq!(
        chain.state.node(&id(1)).unwrap().standing,
        Standing::Suspended
    );
    assert_eq!(
        chain.refusal(enrolled(1)),
        RuleViolation::AlreadyEnrolled(id(1))
    );
    chain.apply(left(&chain.state, 0));
    chain.decide(Action::Revoke(id(0)));
    assert_eq!(
        chain.state.node(&id(0)).unwrap().standing,
        Standing::Revoked
    );
}
