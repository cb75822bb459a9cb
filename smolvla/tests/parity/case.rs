//! A reference folder, and both phases of the policy with its weights.

use candle_core::Device;
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::policy_folder::LeRobotConfig;
use zk0_smolvla::policy::model::expert::ExpertModel;
use zk0_smolvla::policy::model::key_values::PrefixCache;
use zk0_smolvla::policy::model::prefix::{CameraInput, PrefixEmbedding, PrefixInput, PrefixModel};
use zk0_smolvla::policy::model::PolicyParameters;

use crate::reference::{lerobot, policy, Values};

/// The tolerance for values before the transformer.
pub const EARLY: f64 = 5e-5;
/// The tolerance for hidden states and velocities.
pub const HIDDEN: f64 = 1e-4;
/// The tolerance for element-wise losses.
pub const LOSSES: f64 = 5e-4;
/// The tolerance for mean losses.
pub const LOSS: f64 = 1e-5;
/// The tolerance for sampled actions.
pub const SAMPLED: f64 = 2e-4;

/// Returns the last frame of every sample from a batch of histories with `frame` numbers each. LeRobot looks at no other frame.
pub fn last_frames(values: &[f32], frame: usize, batch: usize) -> Vec<f32> {
    let frames = values.len() / frame / batch;
    let last = values.chunks(frame).skip(frames - 1).step_by(frames);
    last.flatten().copied().collect()
}

pub struct Case {
    pub lerobot: LeRobotConfig,
    pub inputs: Values,
    pub outputs: Values,
    pub prefix: PrefixModel,
    pub expert: ExpertModel,
}

impl Case {
    pub fn read() -> Self {
        let policy = policy();
        let mut all = policy.frozen;
        all.extend(policy.expert.into_tensors());
        Self::with(&PolicyParameters::take(all, &Device::Cpu).unwrap())
    }

    pub fn with(parameters: &PolicyParameters) -> Self {
        Self::of(lerobot(), parameters)
    }

    pub fn of(lerobot: LeRobotConfig, parameters: &PolicyParameters) -> Self {
        Self {
            prefix: PrefixModel::new(&lerobot.dims, parameters).unwrap(),
            expert: ExpertModel::new(&lerobot.dims, parameters).unwrap(),
            inputs: Values::read("inputs.safetensors"),
            outputs: Values::read("outputs.safetensors"),
            lerobot,
        }
    }

    pub fn config(&self) -> &PolicyConfig {
        &self.lerobot.dims
    }

    pub fn batch(&self) -> usize {
        self.outputs.shape("prepared.state")[0]
    }

    /// Returns how many cameras LeRobot prepared, including blank ones.
    pub fn cameras(&self) -> usize {
        (0..)
            .take_while(|i| self.outputs.contains(&format!("prepared.image.{i}")))
            .count()
    }

    pub fn prefix_input(&self) -> PrefixInput {
        let cameras = (0..self.cameras()).map(|i| CameraInput {
            pixels: self.outputs.tensor(&format!("prepared.image.{i}")),
            present: self.outputs.flags(&format!("prepared.image_mask.{i}")),
        });
        PrefixInput {
            cameras: cameras.collect(),
            tokens: self.inputs.ids("batch.observation.language.tokens"),
            token_mask: self
                .inputs
                .mask("batch.observation.language.attention_mask"),
            state: self.outputs.tensor("prepared.state"),
        }
    }

    pub fn embedding(&self) -> PrefixEmbedding {
        self.prefix.embed(&self.prefix_input()).unwrap()
    }

    pub fn cache(&self) -> PrefixCache {
        self.prefix.cache(&self.prefix_input()).unwrap()
    }
}
