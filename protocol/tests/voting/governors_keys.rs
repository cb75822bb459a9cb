//! A governor changes its key with both signatures, and keeps its weight, its votes and its proposals. It escapes nothing by that.

use super::{change, other_rules};
use ed25519_dalek::SigningKey;
use zk0_circuits::NodeId;
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::entries::signed::{KeyRotation, KeyTakeover, Vote};
use zk0_protocol::rules::apply::MAX_ROTATIONS;
use zk0_protocol::{Body, Refusal, RefusalCode, RuleViolation, Rules, Signed, State};
use zk0_testkit::network::votes::*;
use zk0_testkit::network::*;

fn identity(key: &SigningKey) -> NodeId {
    NodeId(key.verifying_key().to_bytes())
}

fn moved(state: &State, from: &SigningKey, to: &SigningKey) -> Body {
    let rotation = KeyRotation {
        network: *state.network(),
        node: identity(from),
        with: identity(to),
    };
    Body::KeyRotated {
        rotation: Signed::new(rotation, from),
        takeover: Signed::new(KeyTakeover { rotation }, to),
    }
}

/// `rules` with this key in place of governor 1's.
fn with_key(mut rules: Rules, key: NodeId) -> Rules {
    let governors = &mut rules.governance.governors;
    let moved = governors.iter_mut().find(|one| one.key == governor(1));
    moved.unwrap().key = key;
    governors.sort_by_key(|one| one.key);
    rules
}

fn vote_of(state: &State, voter: &SigningKey, ballot: Ballot) -> Body {
    let vote = Vote {
        network: *state.network(),
        proposal: 0,
        of: digest_of(state, 0),
        voter: identity(voter),
        ballot,
    };
    Body::Voted(Signed::new(vote, voter))
}

#[test]
fn a_governor_keeps_its_votes_and_its_weight_under_another_key() {
    let mut chain = Chain::new();
    chain.apply(proposed(&chain.state, 1, change()));
    chain.apply(voted(&chain.state, 1, 0, Ballot::For));
    chain.apply(moved(&chain.state, &governor_key(1), &key(40)));
    assert_eq!(chain.state.rules(), &with_key(genesis().rules, id(40)));
    let open = &chain.state.proposals()[&0];
    assert_eq!((open.proposer, open.tally().for_it), (id(40), 3));
    let number = 0;
    for (voter, refused) in [
        (governor_key(1), RuleViolation::NoVote(governor(1))),
        (
            key(40),
            RuleViolation::VotedTwice {
                number,
                voter: id(40),
            },
        ),
    ] {
        let vote = vote_of(&chain.state, &voter, Ballot::For);
        assert_eq!(chain.refusal(vote), refused);
    }
    chain.apply(voted(&chain.state, 0, 0, Ballot::For));
    chain.wait(VOTING + TIME_LOCK);
    chain.apply(settled(0, Outcome::Executed));
    // The proposal named the former key.
    assert_eq!(chain.state.rules(), &with_key(other_rules(), id(40)));
    chain.open();
    assert_eq!(
        chain.state.round().unwrap().opened.rules,
        with_key(other_rules(), id(40))
    );
}

/// Its key may be stolen, and the thief may change it.
#[test]
fn another_key_does_not_save_a_governor_from_its_removal() {
    let mut chain = Chain::new();
    let mut rules = genesis().rules;
    let governors = &mut rules.governance.governors;
    governors.retain(|one| one.key != governor(1));
    let removal = Action::ChangeRules(Box::new(rules.clone()));
    chain.apply(proposed(&chain.state, 0, removal));
    chain.apply(moved(&chain.state, &governor_key(1), &key(40)));
    let against = vote_of(&chain.state, &key(40), Ballot::Against);
    assert_eq!(chain.refusal(against), RuleViolation::NoVote(id(40)));
    for by in [0, 2] {
        chain.apply(voted(&chain.state, by, 0, Ballot::For));
    }
    chain.wait(VOTING + TIME_LOCK);
    chain.apply(settled(0, Outcome::Executed));
    assert_eq!(chain.state.rules(), &rules);
}

#[test]
fn both_keys_of_a_governor_sign_and_the_new_one_is_nobodys() {
    let mut chain = Chain::in_round(2);
    let (old, new) = (governor_key(1), key(40));
    let Body::KeyRotated { rotation, takeover } = moved(&chain.state, &old, &new) else {
        unreachable!()
    };
    let forged = [
        Body::KeyRotated {
            rotation: Signed::new(rotation.statement, &new),
            takeover: takeover.clone(),
        },
        Body::KeyRotated {
            rotation: rotation.clone(),
            takeover: Signed::new(takeover.statement, &old),
        },
    ];
    for body in forged {
        let refused = chain.refusal(body);
        let signature = |refusal: &Refusal| refusal.code == RefusalCode::Signature;
        assert!(matches!(&refused, RuleViolation::Refused(refusal) if signature(refusal)));
    }
    for taken in [governor_key(0), governor_key(1)] {
        assert_eq!(
            chain.refusal(moved(&chain.state, &old, &taken)),
            RuleViolation::GovernorsKey(identity(&taken))
        );
    }
    assert_eq!(
        chain.refusal(moved(&chain.state, &old, &key(0))),
        RuleViolation::AlreadyEnrolled(id(0))
    );
    // A node does not take a governor's key in this way either.
    assert_eq!(
        chain.refusal(moved(&chain.state, &key(0), &old)),
        RuleViolation::GovernorsKey(governor(1))
    );
    // An open round does not matter.
    chain.apply(moved(&chain.state, &old, &new));
    assert_eq!(
        chain.refusal(moved(&chain.state, &old, &key(41))),
        RefusalCode::NotEnrolled(governor(1)).into(),
        "the former key is no governor's"
    );
}

/// It may be stolen, and somebody may propose rules from a file that still names it.
#[test]
fn a_former_key_does_not_govern_again() {
    let mut chain = Chain::new();
    chain.apply(moved(&chain.state, &governor_key(1), &key(40)));
    let back = Action::ChangeRules(Box::new(genesis().rules));
    let refused = chain.refusal(proposed(&chain.state, 0, back));
    assert!(
        matches!(&refused, RuleViolation::BadProposal { why, .. } if why.contains("already")),
        "{refused}"
    );
    let rules = with_key(other_rules(), id(40));
    let proposal = proposed(&chain.state, 0, Action::ChangeRules(Box::new(rules)));
    chain.apply(proposal);
}

#[test]
fn a_governor_changes_its_key_a_hundred_times_at_most() {
    let mut chain = Chain::new();
    let key = |turn: u8| match turn {
        0 => governor_key(1),
        turn => {
            let mut seed = [3; 32];
            seed[0] = turn;
            SigningKey::from_bytes(&seed)
        }
    };
    for turn in 0..100 {
        chain.apply(moved(&chain.state, &key(turn), &key(turn + 1)));
    }
    assert_eq!(
        chain.refusal(moved(&chain.state, &key(100), &key(101))),
        RuleViolation::TooManyKeys {
            node: identity(&key(100)),
            limit: MAX_ROTATIONS
        }
    );
}

/// Who governs and has a node with one key changes both.
#[test]
fn one_key_of_both_kinds_stays_one() {
    let mut rules = genesis().rules;
    rules = with_key(rules, id(0));
    let mut chain = Chain::founded(zk0_protocol::Genesis {
        rules: rules.clone(),
        ..genesis()
    });
    chain.apply(enrolled(0));
    let before = chain.state.node(&id(0)).unwrap().clone();
    chain.apply(moved(&chain.state, &key(0), &key(40)));
    assert_eq!(chain.state.node(&id(40)), Some(&before));
    assert_eq!(chain.state.rules(), &with_key(genesis().rules, id(40)));
    assert!(chain.state.node(&id(0)).is_none());
}
