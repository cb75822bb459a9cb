//! The policy with LeRobot's trainable tensors as variables.

use std::collections::BTreeMap;

use candle_core::{Device, Tensor, Var};
use zk0_smolvla::layout::trainable_layout;
use zk0_smolvla::model::{flow, Parameters};

use crate::case::Case;
use crate::reference::{lerobot, policy};

pub struct Training {
    pub variables: BTreeMap<String, Var>,
    pub case: Case,
}

impl Training {
    pub fn new() -> Self {
        let lerobot = lerobot();
        assert!(
            lerobot.training.train_expert_only,
            "training the vision-language model is not implemented"
        );
        let trainable = trainable_layout(&lerobot.dims, lerobot.training.train_state_proj);
        let policy = policy();
        let mut all = policy.frozen;
        all.extend(policy.expert.into_tensors());
        let (parameters, variables) =
            Parameters::with_variables(all, &trainable, &Device::Cpu).unwrap();
        Self {
            variables,
            case: Case::with(&parameters),
        }
    }

    /// Element-wise losses, through the whole policy: the state projection may be trained.
    pub fn losses(&self, noise: &str, time: &str) -> Tensor {
        let case = &self.case;
        let cache = case.prefix.cache(&case.prefix_input()).unwrap();
        let actions = case.outputs.tensor("prepared.action");
        let noise = case.inputs.tensor(noise);
        let times = case.inputs.f32s(time);
        let x_t = flow::noisy_actions(&actions, &noise, &times).unwrap();
        let v_t = case.expert.forward(&cache, &x_t, &times).unwrap();
        flow::losses(&v_t, &flow::target_velocity(&actions, &noise).unwrap()).unwrap()
    }
}
