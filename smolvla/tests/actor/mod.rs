//! Acting: from what the robot sees to a chunk of actions in the robot's units, as LeRobot's `predict_action_chunk`.

use candle_core::Tensor;
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::dataset::Stats;
use zk0_lerobot::tokenizer::Tokenizer;

use zk0_smolvla::error::{PolicyError, Result};
use zk0_smolvla::frames::sample::{CameraImage, Preparer};
use zk0_smolvla::policy::model::expert::ExpertModel;
use zk0_smolvla::policy::model::prefix::PrefixModel;
use zk0_smolvla::policy::model::sampling::sample_actions;
use zk0_smolvla::policy::model::PolicyParameters;

/// What the robot sees.
pub struct Scene<'a> {
    /// At least one, at most as many as the policy has slots.
    pub cameras: Vec<CameraImage<'a>>,
    /// (state_dim), in the robot's units.
    pub state: &'a [f32],
    /// The instruction.
    pub task: &'a str,
}

/// A whole policy, with what it needs to act.
pub struct Actor<'a> {
    preparer: Preparer<'a>,
    expert: ExpertModel,
    stats: Stats,
    steps: usize,
}

impl<'a> Actor<'a> {
    /// For the weights of a whole policy on any device, the statistics it was trained with, and a number of Euler steps
    /// (LeRobot: 10).
    ///
    /// # Errors
    /// [`PolicyError::MissingTensor`], and [`PolicyError::Options`] when statistics or steps do not fit the policy.
    pub fn new(
        config: &PolicyConfig,
        parameters: &PolicyParameters,
        tokenizer: &'a dyn Tokenizer,
        stats: Stats,
        steps: usize,
    ) -> Result<Self> {
        let dims = (stats.state.dim(), stats.action.dim());
        if dims != (config.state_dim, config.action_dim) {
            return Err(PolicyError::Options(format!(
                "the statistics are of {} state and {} action dimensions, the policy has {} and {}",
                dims.0, dims.1, config.state_dim, config.action_dim
            )));
        }
        if steps == 0 {
            return Err(PolicyError::Options(
                "sampling takes at least one step".into(),
            ));
        }
        let prefix = PrefixModel::new(config, parameters)?;
        Ok(Self {
            preparer: Preparer::with_model(config, prefix, tokenizer),
            expert: ExpertModel::new(config, parameters)?,
            stats,
            steps,
        })
    }

    /// The next actions, (chunk_size, action_dim) row by row and in the robot's units, from `noise`
    /// (chunk_size, max_action_dim), standard normal.
    ///
    /// # Errors
    /// [`PolicyError::Sample`] when scene or noise do not fit the policy.
    pub fn action_chunk(&self, scene: &Scene, noise: &[f32]) -> Result<Vec<f32>> {
        let c = self.preparer.config();
        if noise.len() != c.chunk_elements() || !noise.iter().all(|x| x.is_finite()) {
            return Err(PolicyError::Sample(format!(
                "sampling needs {} finite noise values",
                c.chunk_elements()
            )));
        }
        if scene.state.len() != c.state_dim {
            return Err(PolicyError::Sample(format!(
                "the state has {} dimensions, the policy takes {}",
                scene.state.len(),
                c.state_dim
            )));
        }
        let mut state = scene.state.to_vec();
        self.stats.state.normalize(&mut state);
        let cache = self.preparer.prefix(&scene.cameras, &state, scene.task)?;
        let shape = (1, c.chunk_size, c.max_action_dim);
        let noise = Tensor::from_slice(noise, shape, self.preparer.device())?;
        let actions = sample_actions(&self.expert, &cache, &noise, self.steps)?;
        let mut actions: Vec<f32> = actions
            .narrow(2, 0, c.action_dim)?
            .flatten_all()?
            .to_vec1()?;
        self.stats.action.denormalize(&mut actions);
        Ok(actions)
    }
}
