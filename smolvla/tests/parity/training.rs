//! The policy with the reference's trainable tensors as variables.

use std::collections::{BTreeMap, BTreeSet};

use candle_core::{Device, Tensor, Var};
use zk0_lerobot::layout::{trainable_layout, TensorShapes};
use zk0_lerobot::policy_folder::LeRobotConfig;
use zk0_smolvla::policy::model::key_values::PrefixCache;
use zk0_smolvla::policy::model::{flow, PolicyParameters};

use super::case::Case;
use crate::reference::{json, lerobot, policy, training_preset, Values};

pub struct Training {
    pub variables: BTreeMap<String, Var>,
    pub case: Case,
}

/// Returns the tensors that LeRobot would train but that no loss reaches. They stay the same.
pub fn idle() -> BTreeSet<String> {
    let names = json("facts.json")["trainable_without_gradient"].clone();
    serde_json::from_value(names).unwrap_or_default()
}

impl Training {
    pub fn new() -> Self {
        Self::of(lerobot())
    }

    pub fn of(lerobot: LeRobotConfig) -> Self {
        let reference = Values::read("grads.safetensors");
        let shape = |name: &String| (name.clone(), reference.shape(name).to_vec());
        let trainable: TensorShapes = reference.names().map(shape).collect();
        let preset = training_preset();
        if preset.train_expert_only {
            // If the vision-language model is trained too, the library has no matching set, so nothing is compared.
            let mut ours = trainable_layout(&lerobot.dims, preset.train_state_proj);
            ours.retain(|name, _| !idle().contains(name));
            assert_eq!(trainable, ours);
        }
        let policy = policy();
        let mut all = policy.frozen;
        all.extend(policy.expert.into_tensors());
        let (parameters, variables) =
            PolicyParameters::with_variables(all, &trainable, &Device::Cpu).unwrap();
        Self {
            variables,
            case: Case::of(lerobot, &parameters),
        }
    }

    /// Computes element-wise losses through the whole policy, because the state projection may be trained.
    pub fn losses(&self, noise: &str, time: &str) -> Tensor {
        let cache = self.case.prefix.cache(&self.case.prefix_input()).unwrap();
        self.losses_over(&cache, noise, time)
    }

    /// Computes element-wise losses over a prefix.
    pub fn losses_over(&self, cache: &PrefixCache, noise: &str, time: &str) -> Tensor {
        let case = &self.case;
        let actions = case.outputs.tensor("prepared.action");
        let noise = case.inputs.tensor(noise);
        let times = case.inputs.f32s(time);
        let x_t = flow::noisy_actions(&actions, &noise, &times).unwrap();
        let v_t = case.expert.forward(cache, &x_t, &times).unwrap();
        flow::losses(&v_t, &flow::target_velocity(&actions, &noise).unwrap()).unwrap()
    }
}
