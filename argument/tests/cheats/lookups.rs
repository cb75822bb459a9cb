//! Cheats about look-ups: the update's velocity is claimed to be a perfect one, so that its loss is zero.

use super::lies::party::Lie;
use super::lies::Known;
use super::lies::{refused, World};
use zk0_argument::commitment::parameters::CAP;
use zk0_argument::expert::publics::number::{COUNTED, NOISE};
use zk0_argument::expert::sizes::{A, M, S, T};
use zk0_argument::prove::{Computed, Tables};
use zk0_argument::transcript::Refused;

/// A world of which it is stated that the update has no loss on the first sample, and the values of a velocity that has none. All that is wrong with them is
/// that the velocity does not follow from the residual stream: what is left over of the shift is in no table.
fn perfect(samples: usize) -> (World, Known) {
    let mut world = World::random(samples, 21);
    let mut known = world.known.clone();
    let first = &world.known.samples[0].expert;
    let relations = &first.builder.relations;
    let number = |tensor: usize, indices: &[usize]| relations.tensors[tensor].number(indices);
    let (velocity, actions) = (
        world.expert.given.velocity.tensor,
        world.expert.sample.actions.tensor,
    );
    let computed = Computed::default();
    let tables = Tables {
        relations,
        sources: &world.known.sources(),
        computed: &computed,
    };
    let [counted, noise] = [COUNTED, NOISE].map(|public| tables.public(public, &[T, A, S]));
    let sizes = &first.builder.sizes;
    assert_eq!((sizes.of(S), sizes.of(M)), (0, 1));
    for token in 0..sizes.count(T) {
        for action in 0..sizes.count(A) {
            let index = token | action << sizes.of(T);
            if counted[index] == 1 {
                let action_value =
                    world.known.samples[0].data[number(actions, &[token, action, 0])];
                let place = number(velocity, &[token, 1, action, 0]);
                known.samples[0].main[place] = noise[index] - action_value;
            }
        }
    }
    world.statement.samples[0].losses[1] = 0;
    world.state();
    (world, known)
}

#[test]
fn what_is_in_no_table_is_refused() {
    let (world, known) = perfect(1);
    assert_eq!(
        world.told(&known, Lie::Nothing),
        refused("a sum of look-ups")
    );
}

#[test]
fn a_root_that_is_not_the_sum_of_its_layer_is_refused() {
    let (world, known) = perfect(1);
    assert_eq!(
        world.told(&known, Lie::Root),
        refused("a layer of a sum of look-ups")
    );
}

#[test]
fn other_numerators_are_refused() {
    let (world, known) = perfect(1);
    assert_eq!(
        world.told(&known, Lie::Numerators),
        refused("the leaves of a sum of look-ups")
    );
}

#[test]
fn other_denominators_are_refused() {
    let (world, known) = perfect(1);
    assert_eq!(
        world.told(&known, Lie::Leaves),
        refused("the leaves of a sum of look-ups")
    );
}

#[test]
fn leaves_of_several_samples_that_are_others_at_their_point_are_refused() {
    let (world, known) = perfect(2);
    assert_eq!(
        world.told(&known, Lie::Gathered),
        refused("the sumcheck of the leaves of sums")
    );
}

#[test]
fn look_ups_without_work_are_refused() {
    let world = World::random(1, 22);
    let caps = (2 * 4) << CAP;
    assert_eq!(
        world.changed(|proof| proof[caps] += 1),
        Err(Refused::Work("look-ups"))
    );
}
