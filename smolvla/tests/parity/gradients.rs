//! Gradients of every trainable tensor, under both losses.

use candle_core::Tensor;
use zk0_smolvla::policy::model::flow;
use zk0_smolvla::policy::model::kernels::gradients::backward;

use super::training::Training;
use crate::reference::{
    check, is_of_repository, numbers, relative_distance, training_preset, Values,
};

fn gradients_agree(training: &Training, file: &str, loss: &Tensor) {
    let gradients = backward(loss).unwrap();
    let reference = Values::read(file);
    assert!(reference.names().eq(training.variables.keys()));
    for (name, variable) in &training.variables {
        let found = gradients
            .get(variable)
            .unwrap_or_else(|| panic!("{name} has no gradient"));
        assert_eq!(found.dims(), reference.shape(name), "{name}");
        let distance = relative_distance(&numbers(found), reference.numbers(name));
        check(name, distance, 2e-4);
    }
}

#[test]
pub fn gradients_of_the_plain_loss() {
    let training = Training::new();
    let loss = flow::mean_loss(&training.losses("noise", "time")).unwrap();
    gradients_agree(&training, "grads.safetensors", &loss);
}

#[test]
pub fn gradients_of_the_valid_only_loss() {
    let training = Training::new();
    let is_pad = training.case.inputs.mask("batch.action_is_pad");
    let losses = training.losses("noise", "time");
    let action_dim = training.case.config().action_dim;
    let loss = flow::mean_loss_valid_only(&losses, action_dim, &is_pad).unwrap();
    gradients_agree(&training, "grads_valid_only.safetensors", &loss);
}

/// Training with a cached prefix computes only the state's token anew, so only that token has a gradient.
#[test]
pub fn gradients_by_way_of_the_state_token_alone() {
    if !training_preset().train_expert_only {
        assert!(
            !is_of_repository(),
            "the repository's train the expert only"
        );
        println!("not compared: the reference trains the vision-language model too");
        return;
    }
    let training = Training::new();
    let input = training.case.prefix_input();
    let cache = training.case.prefix.cache_training_state(&input).unwrap();
    let loss = flow::mean_loss(&training.losses_over(&cache, "noise", "time")).unwrap();
    gradients_agree(&training, "grads.safetensors", &loss);
}
