//! Cheats about words: what is said has one encoding, and nothing is left over.

use super::lies::opening::{QUERIES, RATE};
use super::lies::party::Lie;
use super::lies::World;
use crate::models::Models;
use zk0_argument::commitment::parameters::{cap_bits, CAP, FOLDS, LAST, SIBLINGS};
use zk0_argument::expert::argument::Shape;
use zk0_argument::expert::sample::prove::digest;
use zk0_argument::transcript::Refused;
use zk0_circuits::EvalSpec;
use zk0_testkit::claims::Parts;

/// What a verifier says of a changed proof.
fn told(world: &World, change: impl FnOnce(&mut Vec<u64>)) -> Result<(), Refused> {
    let mut proof = world.prove(&world.known, Lie::Nothing);
    change(&mut proof);
    let weights = [&world.models.base, &world.models.update];
    world.verify(weights, &proof).map(drop)
}

#[test]
fn words_after_the_end_are_refused() {
    let told = told(&World::random(1, 51), |proof| proof.push(0));
    assert_eq!(told, Err(Refused::Length("more")));
}

#[test]
fn an_argument_that_ends_early_is_refused() {
    let told = told(&World::random(1, 52), |proof| {
        proof.truncate(proof.len() - 1)
    });
    assert_eq!(told, Err(Refused::Length("fewer")));
}

/// A sample of zeros is committed to with p in place of zero. The element is the same, but another word is hashed: if both were accepted, a
/// node could have one sample in its dataset twice, with two leaves.
#[test]
fn a_second_digest_of_one_sample_is_refused() {
    let spec = EvalSpec::micro();
    let mut models = Models::new(&spec, 1, 53);
    let mut parts = Parts::random(&spec, &mut zk0_testkit::claims::Random(53), 2, 0);
    parts.actions.fill(0.0);
    for (keys, values) in &mut parts.cache {
        keys.fill(0.0);
        values.fill(0.0);
    }
    let sample = parts.quantise(&spec);
    models.samples[0].0 = sample.clone();
    let world = World::of(models);
    let weights = [&world.models.base, &world.models.update];
    let proof = world.prove(&world.known, Lie::Zeros);
    let told = world.verify(weights, &proof);
    let told = told.map(|verified| verified.samples == [digest(&spec, &sample).unwrap()]);
    assert!(matches!(told, Err(Refused::NotCanonical(_))), "{told:?}");
}

/// The permutation calculates modulo the prime of KoalaBear, so that a digest would have several encodings, and a proof as well.
#[test]
fn a_second_encoding_of_a_digest_is_refused() {
    const KOALA_BEAR: u64 = 0x7f00_0001;
    let world = World::random(1, 54);
    let shape = Shape::new(&world.expert).unwrap();
    // Words of a query: rows and their paths, and then the leaves that are folded with theirs.
    let height = shape.parameters.variables() as u32;
    let mut length = height + RATE.bits();
    let path = |length: u32, cap: u32| 4 * (length - cap) as usize;
    let widths = shape.widths.iter();
    let rows = widths.map(|width| width + path(length, CAP));
    let mut words = rows.sum::<usize>();
    for _ in 0..(height - LAST).div_ceil(FOLDS as u32) {
        length -= FOLDS as u32;
        words += 2 * SIBLINGS + path(length, cap_bits(length));
    }
    let mut place = 0;
    let told = told(&world, |proof| {
        place = proof.len() - QUERIES * words + shape.widths[0];
        proof[place] += KOALA_BEAR;
    });
    assert_eq!(told, Err(Refused::NotCanonical(place)));
}
