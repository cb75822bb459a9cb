//! Cheats about the digest of a sample: one sample has one digest, so that a dataset holds it once.
//!
//! One of these cheats succeeds, and its test is ignored. A node that wrote its own prover could have one sample in its dataset many times, with
//! a leaf for each copy. It could do nearly the same without a cheat, with copies that differ in one bit.

use super::lies::party::Lie;
use super::lies::Known;
use super::lies::World;
use crate::models::{Models, BLIND};
use zk0_argument::claim::Blind;
use zk0_argument::expert::builder::DATA;
use zk0_argument::expert::sample::prove::committed;
use zk0_circuits::EvalSpec;

/// Whether the argument is accepted, and the first sample has another digest than the one that the sample's node has computed.
fn has_another_digest(truth: &Known, lie: Lie) -> bool {
    let spec = EvalSpec::micro();
    let world = World::of(Models::new(&spec, 1, 81));
    let proof = world.prove(truth, lie);
    let told = world.verify([&world.models.base, &world.models.update], proof.words());
    let (sample, _) = &world.models.samples[0];
    told.is_ok_and(|verified| verified.samples[0] != committed(&spec, sample, &BLIND).0)
}

/// The values of that argument.
fn sample_values() -> (World, Known) {
    let world = World::of(Models::new(&EvalSpec::micro(), 1, 81));
    let sample_values = world.known.clone();
    (world, sample_values)
}

#[test]
fn an_honest_sample_has_the_digest_that_its_node_computes() {
    assert!(!has_another_digest(&sample_values().1, Lie::Nothing));
}

/// A column is longer than the values of a sample. What lies behind them is in no relation.
#[test]
fn what_lies_behind_a_sample_is_zero() {
    let (world, sample_values) = sample_values();
    let (used, end) = (
        world.expert.used[DATA.0 as usize],
        sample_values.samples[0].data.len(),
    );
    for place in [used, (used + end) / 2, end - 1] {
        let mut sample_values = sample_values.clone();
        sample_values.samples[0].data[place] = 1;
        assert!(!has_another_digest(&sample_values, Lie::Nothing));
    }
}

/// Tail and salt are the node's to choose, so that a dishonest one can give a copy another leaf. An argument cannot show more: it shows the values of
/// what is committed to.
#[test]
#[ignore = "a commitment determines values, and not its own digest: the cheat succeeds"]
fn a_sample_that_is_hidden_otherwise_has_the_same_digest() {
    let (sample, spec) = (
        sample_values().0.models.samples[0].0.clone(),
        EvalSpec::micro(),
    );
    let other = committed(&spec, &sample, &Blind::new([6; 32])).0;
    assert_eq!(other, committed(&spec, &sample, &BLIND).0);
}
