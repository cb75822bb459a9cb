//! Row 1. An aggregator draws the randomness of a round for a friend: with keys of its own, until the friend's easiest sample is among those that
//! are evaluated. It signs the log with the right key, and shows it to an auditor.

use crate::attacks::attack::{Attack, Defence, Outcome, Proof};
use crate::attacks::operators::audited;
use ed25519_dalek::SigningKey;
use zk0_circuits::claim::challenge::{challenge, sample_indices};
use zk0_protocol::challenge::closing::commitment;
use zk0_protocol::challenge::drawing::Drawing;
use zk0_protocol::challenge::vrf::VrfProof;
use zk0_protocol::entries::entry::{Body, RandomnessDrawn};
use zk0_testkit::aggregator::operator::Operator;
use zk0_testkit::aggregator::{genesis, weights, SigningNode};
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 1,
    name: "an aggregator draws randomness with many keys, and records what suits a friend",
    module: module_path!(),
    reason: "the proof is not the proof of the log's key for the commitments",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "the randomness is what the source in the rules determines for the closing",
        out: &[SourceChange {
            file: "protocol/src/challenge/drawing.rs",
            replacements: &[(
                ".ok_or(RandomnessError::Vrf(closing.commitments))",
                ".or(OUT.then_some(()))
                    .ok_or(RandomnessError::Vrf(closing.commitments))",
            )],
        }],
    },
    carry_out,
};

/// The sample that is easy for the friend, and how many are evaluated.
const EASY: u64 = 7;
const EVALUATED: u32 = 4;

fn carry_out() -> Outcome {
    let (friend, dir) = (SigningNode::new(1), tempfile::tempdir().unwrap());
    let mut operator = Operator::founds(dir.path(), genesis(), &[&friend]);
    operator.open();
    operator.commit(&friend, &weights(1));
    operator.close_commitments();
    let (state, network) = (operator.state(), *operator.state().network());
    let commitments = state.round().unwrap().closing.unwrap().commitments;
    let statement = friend.commitment(&network, 0, &weights(1));
    let suits = |drawing: &Drawing| {
        let value = drawing.value().unwrap();
        let challenge = challenge(&network, 0, &friend.id(), &commitment(&statement), &value);
        let drawn = sample_indices(&challenge, friend.dataset().samples, EVALUATED).unwrap();
        drawn.contains(&EASY)
    };
    let keys = (1..=255).map(|seed| SigningKey::from_bytes(&[seed; 32]));
    let mut drawings = keys.map(|key| Drawing::LogVrf(VrfProof::of(&key, &commitments.0)));
    let drawing = drawings.find(suits).unwrap();
    operator.forge(Body::RandomnessDrawn(RandomnessDrawn { round: 0, drawing }));
    audited(
        dir.path(),
        "the audit states VERIFIED of randomness that the aggregator picked for a friend",
    )
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
