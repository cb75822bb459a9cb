//! Cheats about sums, and about the weights and tables that the argument leaves to check.

use super::lies::party::Lie;
use super::lies::{refused, World};
use crate::models::Models;
use zk0_circuits::model::layout::Layout;
use zk0_circuits::{EvalSpec, QuantisedWeights};

/// A world of which a lower loss of the update is stated.
fn lower_loss() -> World {
    let mut world = World::random(1, 31);
    world.statement.samples[0].losses[1] /= 2;
    world.state();
    world
}

#[test]
fn a_lower_loss_is_refused() {
    let world = lower_loss();
    assert_eq!(world.told(&world.known, Lie::Nothing), refused("the loss"));
}

#[test]
fn a_sum_of_errors_that_is_lower_is_refused() {
    let world = lower_loss();
    assert_eq!(
        world.told(&world.known, Lie::Loss),
        refused("the sumcheck of the monomials")
    );
}

/// The tale: both models as they are, but for the update's last layer, in which every weight is half as large. The statement is about
/// its losses. In truth the update is what the second world has.
fn calmer_update() -> [World; 2] {
    let spec = EvalSpec::micro();
    let models = || Models::new(&spec, 1, 32);
    let mut calmer = models();
    let layout = Layout::new(&spec.dims);
    let last = layout.tensors.len() - 2;
    let mut bytes = calmer.update.as_bytes().to_vec();
    let place = &layout.tensors[last];
    for value in bytes[2 * place.start..][..2 * place.len].as_chunks_mut().0 {
        *value = (i16::from_le_bytes(*value) / 2).to_le_bytes();
    }
    calmer.update = QuantisedWeights::from_bytes(&spec, &bytes).unwrap();
    [World::of(calmer), World::of(models())]
}

/// All values of the tale, and the weights of the truth.
fn told_with_true_weights(lie: Lie) -> Result<(), zk0_argument::transcript::Refused> {
    let [tale, truth] = calmer_update();
    let losses = [&tale, &truth].map(|world| world.statement.samples[0].losses);
    assert_ne!(losses[0], losses[1]);
    assert_eq!(tale.statement.scales, truth.statement.scales);
    let mut sample_values = tale.known.clone();
    sample_values.common.weights = truth.known.common.weights.clone();
    let prover = tale.prove(&sample_values, lie);
    let weights = [&truth.models.base, &truth.models.update];
    tale.named(&prover, tale.verify(weights, prover.words()).map(drop))
}

#[test]
fn sums_of_products_with_other_weights_are_refused() {
    assert_eq!(
        told_with_true_weights(Lie::Products),
        refused("the sumcheck of the products")
    );
}

#[test]
fn an_argument_about_other_weights_is_refused() {
    assert_eq!(
        told_with_true_weights(Lie::Shared),
        refused("a claim about weights")
    );
}
