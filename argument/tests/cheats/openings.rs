//! Cheats about what was committed to: the losses are those of other samples than the ones that the node's dataset holds.

use super::lies::party::Lie;
use super::lies::{refused, World};
use crate::models::Models;
use zk0_argument::expert::sample::prove::digest;
use zk0_argument::transcript::Refused;
use zk0_circuits::EvalSpec;

/// Tells of one sample, and commits to another one. If that is accepted, then for the digest of the one that was committed to.
fn told(lie: Lie) -> Result<(), Refused> {
    let spec = EvalSpec::micro();
    let tale = World::random(1, 41);
    let truth = World::of(Models {
        samples: Models::new(&spec, 1, 42).samples,
        ..Models::new(&spec, 1, 41)
    });
    let mut witness = tale.known.clone();
    witness.samples[0].data = truth.known.samples[0].data.clone();
    let proof = tale.prove(&witness, lie);
    let verified = tale.verify([&tale.models.base, &tale.models.update], &proof)?;
    let (sample, _) = &truth.models.samples[0];
    assert_eq!(verified.samples, [digest(&spec, sample).unwrap()]);
    Ok(())
}

#[test]
fn claims_about_other_samples_are_refused() {
    assert_eq!(told(Lie::Claims), refused("the sumcheck of the claims"));
}

#[test]
fn the_value_of_other_samples_is_refused() {
    assert_eq!(told(Lie::Shared), refused("the columns of a commitment"));
}

#[test]
fn values_of_other_columns_are_refused() {
    assert_eq!(
        told(Lie::OpenedValues),
        refused("the sumcheck of an opening")
    );
}

#[test]
fn a_combination_of_other_columns_is_refused() {
    assert_eq!(told(Lie::Combination), refused("a fold of an opening"));
}

#[test]
fn rows_of_other_columns_are_refused() {
    assert_eq!(told(Lie::Rows), Err(Refused::Opening));
}

#[test]
fn a_last_message_that_is_not_what_is_folded_is_refused() {
    assert_eq!(
        told(Lie::LastMessage),
        refused("the last message of an opening")
    );
}

#[test]
fn columns_combined_without_work_are_refused() {
    let (what, world) = ("the combination of columns", World::random(1, 43));
    let told = world.told(&world.known, Lie::Idle(what));
    assert_eq!(told, Err(Refused::Work(what)));
}

#[test]
fn positions_without_work_are_refused() {
    let (what, world) = ("positions", World::random(1, 44));
    let told = world.told(&world.known, Lie::Idle(what));
    assert_eq!(told, Err(Refused::Work(what)));
}
