//! The operator gives the log another key. Nobody else does, and only once for each signature.

use super::refused;
use zk0_circuits::NodeId;
use zk0_protocol::challenge::drawing::{Drawing, RandomnessError};
use zk0_protocol::challenge::vrf::VrfProof;
use zk0_protocol::entries::entry::RandomnessDrawn;
use zk0_protocol::entries::signed::{KeyRotation, KeyTakeover};
use zk0_protocol::tlog::key_rotation::{LogKeyRotation, LogKeyTakeover};
use zk0_protocol::{Body, RefusalCode, RuleViolation, Signed};
use zk0_testkit::network::log_keys::*;
use zk0_testkit::network::*;

#[test]
fn the_operator_gives_the_log_another_key_and_once_more_another_one() {
    let mut chain = Chain::new();
    chain.apply(enrolled(0));
    let founding = genesis().log_key;
    assert_eq!(chain.state.log_keys().present(), &founding);
    assert!(chain.state.log_keys().rotation().is_none());
    for number in [1, 2] {
        let (key, entry) = (later_key(number), chain.state.entries());
        let before = *chain.state.log_keys().present();
        chain.apply(log_rotated_to(&chain.state, &key));
        let keys = chain.state.log_keys();
        assert_eq!(keys.present(), &public(&key).0);
        // The new key signs the checkpoint that ends with the entry.
        assert_eq!(keys.at(entry), &before);
        assert_eq!(keys.at(entry + 1), &public(&key).0);
        assert_eq!(keys.rotation().unwrap().statement.entry, entry);
        chain.apply(enrolled(number));
    }
    assert_eq!(chain.state.log_keys().at(2), &founding);
}

#[test]
fn a_stolen_key_gives_the_log_no_other_key() {
    let mut chain = Chain::new();
    let (stolen, new) = (later_key(1), later_key(2));
    chain.apply(log_rotated_to(&chain.state, &stolen));
    let by_thief = LogKeyRotation {
        operator: public(&stolen),
        ..log_rotation(&chain.state, &new)
    };
    assert_eq!(
        chain.refusal(log_rotated(by_thief, &stolen, &new)),
        RuleViolation::NotOperator(public(&stolen))
    );
    let forged = log_rotated(log_rotation(&chain.state, &new), &stolen, &new);
    assert_eq!(refused(chain.refusal(forged)), RefusalCode::Signature);
}

#[test]
fn the_operator_has_the_key_that_it_gives_the_log() {
    let mut chain = Chain::new();
    let (new, other) = (later_key(1), later_key(2));
    let not_its_own = log_rotated(log_rotation(&chain.state, &new), &log_key(), &other);
    assert_eq!(refused(chain.refusal(not_its_own)), RefusalCode::Signature);
    let rotation = log_rotation(&chain.state, &new);
    let takeover = LogKeyTakeover {
        rotation: LogKeyRotation {
            entry: 7,
            ..rotation.clone()
        },
    };
    let of_another_change = Body::LogKeyRotated {
        rotation: Signed::new(rotation, &log_key()),
        takeover: Signed::new(takeover, &new),
    };
    assert_eq!(
        chain.refusal(of_another_change),
        RuleViolation::OtherLogTakeover(public(&new))
    );
}

#[test]
fn a_change_of_the_logs_key_counts_once_and_at_its_place() {
    let mut chain = Chain::new();
    let key = later_key(1);
    let rotated = log_rotated_to(&chain.state, &key);
    chain.apply(enrolled(0));
    let past = RuleViolation::OtherLogKeyEntry { entry: 1, next: 2 };
    assert_eq!(chain.refusal(rotated), past);
    let rotated = log_rotated_to(&chain.state, &key);
    chain.apply(rotated.clone());
    let twice = RuleViolation::OtherLogKeyEntry { entry: 2, next: 3 };
    assert_eq!(chain.refusal(rotated), twice);
}

#[test]
fn the_logs_new_key_is_nobody_elses_and_none_that_it_had() {
    let mut chain = Chain::new();
    chain.apply(enrolled(0));
    let rotation = KeyRotation {
        network: *chain.state.network(),
        node: id(0),
        with: id(1),
    };
    chain.apply(Body::KeyRotated {
        rotation: Signed::new(rotation, &key(0)),
        takeover: Signed::new(KeyTakeover { rotation }, &key(1)),
    });
    chain.apply(log_rotated_to(&chain.state, &later_key(1)));
    chain.apply(log_rotated_to(&chain.state, &later_key(2)));
    let used = [
        log_key(),
        later_key(1),
        later_key(2),
        key(0),
        key(1),
        governor_key(0),
    ];
    for used in used {
        assert_eq!(
            chain.refusal(log_rotated_to(&chain.state, &used)),
            RuleViolation::UsedKey(public(&used))
        );
    }
    let weak = LogKeyRotation {
        with: NodeId([0; 32]),
        ..log_rotation(&chain.state, &later_key(3))
    };
    let weak = log_rotated(weak, &log_key(), &later_key(3));
    assert_eq!(refused(chain.refusal(weak)), RefusalCode::Signature);
}

#[test]
fn a_change_for_another_network_or_log_is_refused() {
    let mut chain = Chain::new();
    let key = later_key(1);
    let elsewhere = LogKeyRotation {
        network: digest(1),
        ..log_rotation(&chain.state, &key)
    };
    let elsewhere = log_rotated(elsewhere, &log_key(), &key);
    assert!(matches!(
        refused(chain.refusal(elsewhere)),
        RefusalCode::WrongNetwork { .. }
    ));
    let other_log = LogKeyRotation {
        log: "another.log".into(),
        ..log_rotation(&chain.state, &key)
    };
    assert_eq!(
        chain.refusal(log_rotated(other_log, &log_key(), &key)),
        RuleViolation::OtherLog {
            found: "another.log".into(),
            expected: genesis().name
        }
    );
}

/// Otherwise the operator could try keys until the randomness suits it.
#[test]
fn a_round_has_the_randomness_of_the_key_that_opened_it() {
    let mut chain = Chain::in_round(1);
    let new = later_key(1);
    assert!(chain.state.has_drawing_key());
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.apply(log_rotated_to(&chain.state, &new));
    chain.close_commitments();
    assert!(!chain.state.has_drawing_key());
    let round = chain.state.round().unwrap();
    let input = round.closing.unwrap().commitments;
    let by_new = Body::RandomnessDrawn(RandomnessDrawn {
        round: 0,
        drawing: Drawing::LogVrf(VrfProof::of(&new, &input.0)),
    });
    let refused = chain.refusal(by_new);
    let RuleViolation::BadRandomness { error, .. } = refused else {
        panic!("{refused}");
    };
    assert_eq!(error, RandomnessError::Vrf(input));
    chain.apply(Body::RandomnessDrawn(drawn(&chain.state)));
}
