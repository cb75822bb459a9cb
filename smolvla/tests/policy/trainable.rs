//! The two sets of trainable tensors. The tests show which tensors they hold, and that the loss reaches each of them and nothing
//! else.

use std::collections::{BTreeMap, BTreeSet};

use candle_core::{DType, Device, Tensor, Var};
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::layout::{policy_layout, trainable_layout, TensorShapes};
use zk0_lerobot::StoredPolicyError;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::model::expert::ExpertModel;
use zk0_smolvla::policy::model::flow::{losses, mean_loss, noisy_actions, target_velocity};
use zk0_smolvla::policy::model::kernels::gradients::backward;
use zk0_smolvla::policy::model::prefix::{CameraInput, PrefixInput, PrefixModel};
use zk0_smolvla::policy::model::PolicyParameters;
use zk0_smolvla::policy::profile::Profile;
use zk0_smolvla::train::optimizer::{AdamW, AdamWOptions, Optimizer};
use zk0_smolvla::PolicyError;
use zk0_tensors::TensorError;

use crate::reference::{numbers, published_parameters};

/// At the published size, one set is LeRobot's default. Ours is the same without the state projection.
#[test]
fn the_published_sets_are_lerobots() {
    let facts = published_parameters();
    let mut expected = TensorShapes::new();
    for parameter in facts["parameters"].as_array().unwrap() {
        if parameter["trainable"].as_bool().unwrap() {
            let name = parameter["name"].as_str().unwrap().to_string();
            let shape = serde_json::from_value(parameter["shape"].clone()).unwrap();
            expected.insert(name, shape);
        }
    }
    let config = Profile::Full.config();
    let found = trainable_layout(&config, true);
    assert_eq!(found, expected);
    let count = |layout: &TensorShapes| -> usize {
        layout
            .values()
            .map(|shape| shape.iter().product::<usize>())
            .sum()
    };
    assert_eq!((found.len(), count(&found)), (155, 99_880_992));

    expected.retain(|name, _| !name.starts_with("model.state_proj."));
    let alone = trainable_layout(&config, false);
    assert_eq!(alone, expected);
    assert_eq!((alone.len(), count(&alone)), (153, 99_880_992 - 31_680));
}

/// A smooth, uneven tensor.
fn wave(shape: &[usize]) -> Tensor {
    let elements: usize = shape.iter().product();
    let values = (0..elements).map(|i| ((i * i) as f32 * 0.37 + 0.2).sin());
    Tensor::from_iter(values, &Device::Cpu)
        .unwrap()
        .reshape(shape)
        .unwrap()
}

/// Returns the gradients of the mean loss of a batch of two, by name, for variables and for constants.
fn gradients(config: &PolicyConfig, train_state_proj: bool) -> BTreeMap<String, Tensor> {
    let policy = init_policy(config, 5).unwrap();
    let mut all = policy.frozen;
    all.extend(policy.expert.into_tensors());
    let trainable = trainable_layout(config, train_state_proj);
    let (parameters, variables) =
        PolicyParameters::with_variables(all, &trainable, &Device::Cpu).unwrap();
    assert_eq!(variables.len(), trainable.len());
    let prefix = PrefixModel::new(config, &parameters).unwrap();
    let expert = ExpertModel::new(config, &parameters).unwrap();

    let size = config.vision.image_size;
    let camera = || CameraInput {
        pixels: wave(&[2, 3, size, size]),
        present: vec![true, true],
    };
    let cache = prefix
        .cache(&PrefixInput {
            cameras: (0..config.cameras).map(|_| camera()).collect(),
            tokens: Tensor::new(&[[1u32, 2, 3], [4, 5, 0]], &Device::Cpu).unwrap(),
            token_mask: vec![vec![true; 3], vec![true, true, false]],
            state: wave(&[2, config.max_state_dim]),
        })
        .unwrap();
    let shape = [2, config.chunk_size, config.max_action_dim];
    let (actions, noise) = (wave(&shape), wave(&shape).sin().unwrap());
    let times = [0.3, 0.8];
    let x_t = noisy_actions(&actions, &noise, &times).unwrap();
    let v_t = expert.forward(&cache, &x_t, &times).unwrap();
    let loss = mean_loss(&losses(&v_t, &target_velocity(&actions, &noise).unwrap()).unwrap());
    let store = backward(&loss.unwrap()).unwrap();

    policy_layout(config)
        .into_keys()
        .filter_map(|name| {
            let gradient = store.get(&parameters.get(&name).unwrap())?.clone();
            Some((name, gradient))
        })
        .collect()
}

#[test]
fn every_trainable_tensor_gets_a_gradient_and_no_frozen_one() {
    let mut all_cross = Profile::Tiny.config();
    all_cross.self_attn_every = 0;
    let mut all_joint = Profile::Tiny.config();
    (all_joint.self_attn_every, all_joint.prefix_length) = (1, 20);
    for config in [Profile::Tiny.config(), all_cross, all_joint] {
        for train_state_proj in [false, true] {
            let found = gradients(&config, train_state_proj);
            let trainable = trainable_layout(&config, train_state_proj);
            let names: BTreeSet<&String> = found.keys().collect();
            assert_eq!(names, trainable.keys().collect());
            for (name, gradient) in &found {
                let norm: f64 = numbers(gradient).iter().map(|x| x * x).sum();
                assert!(norm.is_finite() && norm > 0.0, "{name}: {norm}");
            }
        }
    }
}

#[test]
fn a_variable_that_the_loss_does_not_reach_is_an_error() {
    let lost = Var::zeros(3, DType::F32, &Device::Cpu).unwrap();
    let used = Var::ones(3, DType::F32, &Device::Cpu).unwrap();
    let variables = BTreeMap::from([
        ("lost".to_string(), lost),
        ("used".to_string(), used.clone()),
    ]);
    let mut optimizer = AdamW::new(&variables, AdamWOptions::default()).unwrap();
    let gradients = used.sqr().unwrap().sum_all().unwrap().backward().unwrap();
    let error = optimizer.step(&gradients, 1e-3).unwrap_err();
    assert!(
        matches!(&error, PolicyError::NoGradient(name) if name == "lost"),
        "{error}"
    );
}

#[test]
fn a_trainable_tensor_that_is_not_there_is_named() {
    let config = Profile::Micro.config();
    let frozen = init_policy(&config, 1).unwrap().frozen;
    let trainable = trainable_layout(&config, true);
    let missing = PolicyParameters::with_variables(frozen, &trainable, &Device::Cpu);
    assert!(matches!(
        missing.err(),
        Some(PolicyError::Stored(StoredPolicyError::Tensor(
            TensorError::Missing(_)
        )))
    ));
}
