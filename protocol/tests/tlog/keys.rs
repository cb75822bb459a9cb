//! Who knows a log's founding key verifies the checkpoints of its later keys.

use zk0_protocol::tlog::checkpoint::{CheckpointError, KeyedCheckpoint};
use zk0_protocol::tlog::key_rotation::{self, LogKeyRotation};
use zk0_protocol::{Checkpoint, Signed, WitnessPolicy};
use zk0_testkit::network::log::{log_vkey, ORIGIN};
use zk0_testkit::network::log_keys::*;
use zk0_testkit::network::*;

const CHECKPOINT: Checkpoint = Checkpoint {
    size: 12,
    root: zk0_circuits::Digest([0x33; 32]),
};

fn rotation(entry: u64) -> LogKeyRotation {
    LogKeyRotation {
        entry,
        ..log_rotation(&Chain::new().state, &later_key(1))
    }
}

/// The checkpoint, signed by the log's later key, with the operator's statement.
fn signed(rotation: LogKeyRotation) -> Vec<u8> {
    let rotation = Signed::new(rotation, &log_key());
    CHECKPOINT
        .sign_after(ORIGIN, &later_key(1), Some(&rotation))
        .unwrap()
}

fn open(text: &[u8]) -> Result<KeyedCheckpoint, CheckpointError> {
    KeyedCheckpoint::open(text, ORIGIN, &genesis().log_key)
}

#[test]
fn a_later_key_is_followed_from_the_founding_one() {
    let text = signed(rotation(11));
    let opened = open(&text).unwrap();
    assert_eq!(opened.checkpoint, CHECKPOINT);
    assert_eq!((opened.key, opened.since), (public(&later_key(1)).0, 11));
    opened.check_key(&public(&later_key(1)).0).unwrap();
    opened.check_network(&rotation(11).network).unwrap();
    let refused = opened.check_network(&digest(9)).unwrap_err();
    assert!(matches!(refused, CheckpointError::Rotation(_)), "{refused}");
    let refused = opened.check_key(&genesis().log_key).unwrap_err();
    assert!(refused.contains("the log's key there is"), "{refused}");
    let witnessed = WitnessPolicy::none().open(&text, &log_vkey()).unwrap();
    assert_eq!(witnessed.checkpoint, CHECKPOINT);
    assert_eq!(witnessed.key, public(&later_key(1)).0);
    let founding = open(&CHECKPOINT.sign(ORIGIN, &log_key()).unwrap()).unwrap();
    assert_eq!((founding.key, founding.since), (genesis().log_key, 0));
}

#[test]
fn a_later_key_needs_the_operators_statement() {
    let bare = CHECKPOINT.sign(ORIGIN, &later_key(1)).unwrap();
    assert!(matches!(open(&bare), Err(CheckpointError::Signature(_))));
    // A thief has the log's later key, and signs a statement about a key of its own.
    let by_thief = LogKeyRotation {
        operator: public(&later_key(1)),
        with: public(&later_key(2)),
        ..rotation(3)
    };
    let by_thief = Signed::new(by_thief, &later_key(1));
    let bare = CHECKPOINT.sign(ORIGIN, &later_key(2)).unwrap();
    let line = key_rotation::line(&by_thief, &log_vkey()).to_bytes();
    let refused = open(&[bare, line].concat()).unwrap_err();
    assert!(refused.to_string().contains("founded the log"), "{refused}");
    let forged = Signed::new(rotation(3), &later_key(1));
    let text = CHECKPOINT
        .sign_after(ORIGIN, &later_key(1), Some(&forged))
        .unwrap();
    assert!(matches!(open(&text), Err(CheckpointError::Rotation(_))));
}

#[test]
fn a_later_key_signs_no_earlier_checkpoint_and_for_no_other_log() {
    let refused = open(&signed(rotation(12))).unwrap_err();
    assert!(refused.to_string().contains("entry 12 gave"), "{refused}");
    let elsewhere = LogKeyRotation {
        log: "another.log".into(),
        ..rotation(3)
    };
    let refused = open(&signed(elsewhere)).unwrap_err();
    assert!(refused.to_string().contains("another log"), "{refused}");
}

/// Nothing can be added, removed or changed.
#[test]
fn a_checkpoint_of_a_later_key_has_one_form() {
    let text = signed(rotation(3));
    open(&text).unwrap();
    for position in 0..text.len() {
        for bit in 0..8 {
            let mut changed = text.clone();
            changed[position] ^= 1 << bit;
            assert!(
                open(&changed).is_err(),
                "bit {bit} of byte {position} does not matter"
            );
        }
        assert!(open(&text[..position]).is_err());
    }
    let lines: Vec<_> = text.split_inclusive(|byte| *byte == b'\n').collect();
    let [head @ .., by_key, by_operator] = &lines[..] else {
        panic!("{} lines", lines.len());
    };
    for other in [vec![*by_operator, *by_key], vec![*by_operator]] {
        assert!(open(&[head, &other].concat().concat()).is_err());
    }
    assert!(open(&[&text[..], *by_operator].concat()).is_err());
}
