//! Gradients of every trainable tensor, under both losses.

use std::collections::BTreeSet;

use candle_core::Tensor;
use zk0_smolvla::model::flow;

use crate::reference::{check, json, numbers, relative_distance, Values};
use crate::training::Training;

fn gradients_agree(training: &Training, file: &str, loss: &Tensor) {
    let gradients = loss.backward().unwrap();
    let reference = Values::read(file);
    let idle = json("facts.json")["trainable_without_gradient"].clone();
    let idle: BTreeSet<String> = serde_json::from_value(idle).unwrap_or_default();
    let names: BTreeSet<&String> = training.variables.keys().collect();
    let expected: BTreeSet<&String> = reference.names().chain(&idle).collect();
    assert_eq!(names, expected);
    for name in reference.names() {
        let found = gradients
            .get(&training.variables[name])
            .unwrap_or_else(|| panic!("{name} has no gradient"));
        assert_eq!(found.dims(), reference.shape(name), "{name}");
        check(
            name,
            relative_distance(&numbers(found), reference.numbers(name)),
            2e-4,
        );
    }
}

#[test]
fn gradients_of_the_plain_loss() {
    let training = Training::new();
    let loss = flow::mean_loss(&training.losses("noise", "time")).unwrap();
    gradients_agree(&training, "grads.safetensors", &loss);
}

#[test]
fn gradients_of_the_valid_only_loss() {
    let training = Training::new();
    let is_pad = training.case.inputs.mask("batch.action_is_pad");
    let losses = training.losses("noise", "time");
    let action_dim = training.case.config().action_dim;
    let loss = flow::mean_loss_valid_only(&losses, action_dim, &is_pad).unwrap();
    gradients_agree(&training, "grads_valid_only.safetensors", &loss);
}
