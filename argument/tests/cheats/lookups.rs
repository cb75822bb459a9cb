//! Cheats about look-ups: the update's velocity is claimed to be a perfect one, so that its loss is zero.

use crate::lies::party::Lie;
use crate::lies::{copy, refused, World};
use zk0_argument::expert::publics::number::{COUNTED, NOISE};
use zk0_argument::expert::sizes::{A, M, S, T};
use zk0_argument::expert::witness::Witness;
use zk0_argument::prove::{Computed, Tables};
use zk0_argument::transcript::Refused;

/// A world of which it is stated that the update has no loss, and the values of a velocity that has none. All that is wrong with them is
/// that the velocity does not follow from the residual stream: what is left over of the shift is in no table.
fn perfect() -> (World, Witness) {
    let mut world = World::random(1, 21);
    let mut witness = copy(&world.witness);
    let relations = &world.expert.builder.relations;
    let number = |tensor: usize, indices: &[usize]| relations.tensors[tensor].number(indices);
    let (velocity, actions) = (
        world.expert.given.velocity.tensor,
        world.expert.sample.actions.tensor,
    );
    let computed = Computed::default();
    let tables = Tables {
        relations,
        sources: &world.witness.sources(),
        computed: &computed,
    };
    let [counted, noise] = [COUNTED, NOISE].map(|public| tables.public(public, &[T, A, S]));
    let sizes = &world.expert.builder.sizes;
    assert_eq!((sizes.of(S), sizes.of(M)), (0, 1));
    for token in 0..sizes.count(T) {
        for action in 0..sizes.count(A) {
            let index = token | action << sizes.of(T);
            if counted[index] == 1 {
                let action_value = world.witness.data[number(actions, &[token, action, 0])];
                let place = number(velocity, &[token, 1, action, 0]);
                witness.main[place] = noise[index] - action_value;
            }
        }
    }
    world.statement.samples[0].losses[1] = 0;
    world.state();
    (world, witness)
}

#[test]
fn what_is_in_no_table_is_refused() {
    let (world, witness) = perfect();
    assert_eq!(
        world.told(&witness, Lie::Nothing),
        refused("a sum of look-ups")
    );
}

#[test]
fn a_root_that_is_not_the_sum_of_its_layer_is_refused() {
    let (world, witness) = perfect();
    assert_eq!(
        world.told(&witness, Lie::Root),
        refused("a layer of a sum of look-ups")
    );
}

#[test]
fn other_numerators_are_refused() {
    let (world, witness) = perfect();
    assert_eq!(
        world.told(&witness, Lie::Numerators),
        refused("the leaves of a sum of look-ups")
    );
}

#[test]
fn other_denominators_are_refused() {
    let (world, witness) = perfect();
    assert_eq!(
        world.told(&witness, Lie::Leaves),
        refused("the leaves of a sum of look-ups")
    );
}

#[test]
fn look_ups_without_work_are_refused() {
    let world = World::random(1, 22);
    assert_eq!(
        world.told(&world.witness, Lie::Idle("look-ups")),
        Err(Refused::Work("look-ups"))
    );
}
