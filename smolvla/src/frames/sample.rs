//! Prepared samples: what one frame contributes to training and to a claim.
//!
//! The policy's frozen half runs once per frame. A sample has its key/value cache without padding tokens (they influence nothing), the
//! normalised action chunk, and which of its frames are padding.
//!
//! For training the state projection, a frame is an [`ObservedSample`]: the state's token, which no other token sees, changes at each step.

use candle_core::{Device, Tensor};
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::tokenizer::Tokenizer;

use crate::error::{PolicyError, Result};
use crate::frames::cameras::camera_slots;
use crate::frames::image::{unit_vision_input, vision_input};
use crate::policy::frozen::FrozenPlace;
use crate::policy::model::key_values::PrefixCache;
use crate::policy::model::prefix::{CameraInput, PrefixInput, PrefixModel};
use crate::policy::model::PolicyParameters;
use crate::policy::weights::Policy;

/// One frame, ready for the expert.
#[derive(Clone, Debug, PartialEq)]
pub struct PreparedSample {
    /// The prefix's tokens, all of them real.
    pub prefix_tokens: usize,
    /// Per layer (prefix_tokens, kv_width), after the rotary embedding.
    pub keys: Vec<Vec<f32>>,
    /// Per layer (prefix_tokens, kv_width).
    pub values: Vec<Vec<f32>>,
    /// (chunk_size, max_action_dim), normalised and zero-padded.
    pub actions: Vec<f32>,
    /// Per frame of the chunk: past the episode's end.
    pub is_pad: Vec<bool>,
}

/// One frame with its state apart.
#[derive(Clone, Debug, PartialEq)]
pub struct ObservedSample {
    /// The prepared sample without the state's token, the last.
    pub observed: PreparedSample,
    /// (max_state_dim), normalised and zero-padded.
    pub state: Vec<f32>,
}

/// A kind of sample made from a frame.
pub trait FromFrame: Clone + Send + 'static {
    /// Runs the frozen half over one frame.
    ///
    /// # Errors
    /// Those of [`Preparer::prepare`].
    fn from_frame(preparer: &Preparer, observation: &Observation) -> Result<Self>;

    /// Checks that the sample fits the policy and is finite.
    ///
    /// # Errors
    /// What is wrong.
    fn check(&self, config: &PolicyConfig) -> std::result::Result<(), String>;
}

impl FromFrame for PreparedSample {
    fn from_frame(preparer: &Preparer, observation: &Observation) -> Result<Self> {
        preparer.prepare(observation)
    }

    fn check(&self, config: &PolicyConfig) -> std::result::Result<(), String> {
        if !(1..=config.max_prefix_tokens()).contains(&self.prefix_tokens) {
            return Err(format!(
                "{} prefix tokens, the policy takes 1 to {}",
                self.prefix_tokens,
                config.max_prefix_tokens()
            ));
        }
        let layer = self.prefix_tokens * config.kv_width();
        for (what, layers) in [("keys", &self.keys), ("values", &self.values)] {
            if layers.len() != config.text.layers || layers.iter().any(|l| l.len() != layer) {
                return Err(format!(
                    "its {what} are not {} layers of {layer} values",
                    config.text.layers
                ));
            }
            for values in layers {
                finite(what, values)?;
            }
        }
        check_actions(config, &self.actions, &self.is_pad)
    }
}

impl FromFrame for ObservedSample {
    fn from_frame(preparer: &Preparer, observation: &Observation) -> Result<Self> {
        preparer.observe(observation)
    }

    fn check(&self, config: &PolicyConfig) -> std::result::Result<(), String> {
        self.observed.check(config)?;
        if self.observed.prefix_tokens == config.max_prefix_tokens() {
            return Err("its prefix leaves no room for the state".into());
        }
        if self.state.len() != config.max_state_dim {
            return Err(format!(
                "{} state values, the policy takes {}",
                self.state.len(),
                config.max_state_dim
            ));
        }
        finite("state", &self.state)
    }
}

fn check_actions(
    config: &PolicyConfig,
    actions: &[f32],
    is_pad: &[bool],
) -> std::result::Result<(), String> {
    if actions.len() != config.chunk_elements() || is_pad.len() != config.chunk_size {
        return Err(format!(
            "{} action values and {} padding flags, the policy takes {} and {}",
            actions.len(),
            is_pad.len(),
            config.chunk_elements(),
            config.chunk_size
        ));
    }
    finite("actions", actions)
}

fn finite(what: &str, values: &[f32]) -> std::result::Result<(), String> {
    if values.iter().all(|x| x.is_finite()) {
        Ok(())
    } else {
        Err(format!("its {what} hold a value that is not finite"))
    }
}

/// One camera's picture.
pub struct CameraImage<'a> {
    /// The camera's name in the recording, for [`camera_slots`].
    pub name: &'a str,
    /// Pixels from top to bottom.
    pub height: usize,
    /// Pixels from left to right.
    pub width: usize,
    /// RGB (3, height, width).
    pub pixels: Pixels<'a>,
}

/// The pixels of a picture.
#[derive(Clone, Copy, Debug)]
pub enum Pixels<'a> {
    /// 8 bits each, as recorded.
    Bytes(&'a [u8]),
    /// Between 0 and 1.
    Unit(&'a [f32]),
}

impl Pixels<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Bytes(pixels) => pixels.len(),
            Self::Unit(pixels) => pixels.len(),
        }
    }
}

/// One frame of a recording, normalised.
pub struct Observation<'a> {
    /// All of the recording's cameras. [`camera_slots`] chooses.
    pub cameras: Vec<CameraImage<'a>>,
    /// (state_dim), normalised.
    pub state: &'a [f32],
    /// (chunk_size, action_dim), normalised.
    pub actions: &'a [f32],
    /// (chunk_size): past the end of the episode.
    pub is_pad: &'a [bool],
    /// The instruction.
    pub task: &'a str,
}

/// Runs a policy's frozen half over frames.
pub struct Preparer<'a> {
    model: PrefixModel,
    tokenizer: &'a dyn Tokenizer,
    config: PolicyConfig,
}

impl<'a> Preparer<'a> {
    /// For the frozen half of `policy`, as in dataset commitments.
    pub fn new(policy: &Policy, tokenizer: &'a dyn Tokenizer) -> Result<Self> {
        let place = FrozenPlace::default();
        let parameters = PolicyParameters::load(&policy.frozen, &place.device)?;
        Self::of(&place, &policy.config, parameters, tokenizer)
    }

    /// For the frozen half of `policy` at `place`, without a copy (1.4 GB) on the CPU.
    pub fn at(place: &FrozenPlace, policy: Policy, tokenizer: &'a dyn Tokenizer) -> Result<Self> {
        let parameters = PolicyParameters::take(policy.frozen, &place.device)?;
        Self::of(place, &policy.config, parameters, tokenizer)
    }

    fn of(
        place: &FrozenPlace,
        config: &PolicyConfig,
        frozen: PolicyParameters,
        tokenizer: &'a dyn Tokenizer,
    ) -> Result<Self> {
        let model = PrefixModel::new(config, &frozen.in_precision(place.precision))?;
        Ok(Self::with_model(config, model, tokenizer))
    }

    /// For a loaded frozen half of these dimensions.
    pub fn with_model(
        config: &PolicyConfig,
        model: PrefixModel,
        tokenizer: &'a dyn Tokenizer,
    ) -> Self {
        Self {
            model,
            tokenizer,
            config: config.clone(),
        }
    }

    /// The policy's dimensions.
    pub fn config(&self) -> &PolicyConfig {
        &self.config
    }

    /// The device that computes.
    pub fn device(&self) -> &Device {
        self.model.device()
    }

    /// The tokenizer of instructions.
    pub fn tokenizer(&self) -> &dyn Tokenizer {
        self.tokenizer
    }

    /// Prepares one frame.
    ///
    /// # Errors
    /// [`PolicyError::Sample`] names the value.
    pub fn prepare(&self, observation: &Observation) -> Result<PreparedSample> {
        let c = &self.config;
        check_chunk(c, observation)?;
        let cache = self.prefix(&observation.cameras, observation.state, observation.task)?;
        let kept: Vec<u32> = (0..)
            .zip(&cache.valid[0])
            .filter(|(_, valid)| **valid)
            .map(|(token, _)| token)
            .collect();
        let tokens = kept.len();
        let kept = Tensor::from_vec(kept, tokens, self.device())?;
        let plain = |layers: &[Tensor]| -> Result<Vec<Vec<f32>>> {
            layers
                .iter()
                .map(|layer| {
                    let layer = layer.index_select(&kept, 1)?;
                    Ok(layer.flatten_all()?.to_vec1()?)
                })
                .collect()
        };
        Ok(PreparedSample {
            prefix_tokens: tokens,
            keys: plain(&cache.keys)?,
            values: plain(&cache.values)?,
            actions: widen(observation.actions, c.action_dim, c.max_action_dim),
            is_pad: observation.is_pad.to_vec(),
        })
    }

    /// Prepares one frame without its state.
    ///
    /// # Errors
    /// Those of [`Self::prepare`].
    pub fn observe(&self, observation: &Observation) -> Result<ObservedSample> {
        let c = &self.config;
        // Only the state's token sees the state.
        let mut observed = self.prepare(observation)?;
        observed.prefix_tokens -= 1;
        let values = observed.prefix_tokens * c.kv_width();
        let layers = observed.keys.iter_mut().chain(&mut observed.values);
        layers.for_each(|layer| layer.truncate(values));
        Ok(ObservedSample {
            observed,
            state: widen(observation.state, c.state_dim, c.max_state_dim),
        })
    }

    /// The prefix cache of the robot's view: cameras, normalised state (state_dim) and instruction. A batch of one.
    ///
    /// # Errors
    /// Those of [`Self::prepare`].
    pub fn prefix(
        &self,
        cameras: &[CameraImage],
        state: &[f32],
        task: &str,
    ) -> Result<PrefixCache> {
        let c = &self.config;
        check_view(c, cameras, state)?;
        let device = self.device();
        let size = c.vision.image_size;
        let names: Vec<&str> = cameras.iter().map(|camera| camera.name).collect();
        // No token attends to blank cameras.
        let slots = camera_slots(c, 0, &names)?;
        let cameras = slots.into_iter().flatten().map(|i| {
            let camera = &cameras[i];
            let shape = (camera.height, camera.width);
            let pixels = match camera.pixels {
                Pixels::Bytes(pixels) => vision_input(pixels, shape, size),
                Pixels::Unit(pixels) => unit_vision_input(pixels, shape, size),
            };
            Ok(CameraInput {
                pixels: Tensor::from_vec(pixels, (1, 3, size, size), device)?,
                present: vec![true],
            })
        });
        let tokens = self.tokenizer.tokens(task)?;
        if tokens.len() > c.max_language_tokens
            || tokens.iter().any(|id| *id as usize >= c.text.vocabulary)
        {
            return Err(PolicyError::Sample(format!(
                "the tokenizer gave {tokens:?}, which the policy cannot read"
            )));
        }
        let count = tokens.len();
        self.model.cache(&PrefixInput {
            cameras: cameras.collect::<Result<_>>()?,
            tokens: Tensor::from_vec(tokens, (1, count), device)?,
            token_mask: vec![vec![true; count]],
            state: Tensor::from_vec(
                widen(state, c.state_dim, c.max_state_dim),
                (1, c.max_state_dim),
                device,
            )?,
        })
    }
}

fn check_view(c: &PolicyConfig, cameras: &[CameraImage], state: &[f32]) -> Result<()> {
    for camera in cameras {
        let pixels = camera
            .height
            .checked_mul(camera.width)
            .and_then(|n| n.checked_mul(3));
        if pixels.is_none_or(|n| n == 0 || n != camera.pixels.len()) {
            return Err(PolicyError::Sample(format!(
                "camera `{}`: {} values are not a {} x {} RGB picture",
                camera.name,
                camera.pixels.len(),
                camera.height,
                camera.width
            )));
        }
    }
    if state.len() != c.state_dim {
        return Err(PolicyError::Sample(format!(
            "the state has {} dimensions, the policy takes {}",
            state.len(),
            c.state_dim
        )));
    }
    check_finite("state", state)
}

fn check_chunk(c: &PolicyConfig, observation: &Observation) -> Result<()> {
    if observation.is_pad.len() != c.chunk_size
        || observation.actions.len() != c.chunk_size * c.action_dim
    {
        return Err(PolicyError::Sample(format!(
            "{} action values and {} padding flags, the policy takes {} frames of {} dimensions",
            observation.actions.len(),
            observation.is_pad.len(),
            c.chunk_size,
            c.action_dim
        )));
    }
    check_finite("action", observation.actions)
}

fn check_finite(what: &str, values: &[f32]) -> Result<()> {
    match values.iter().position(|x| !x.is_finite()) {
        Some(at) => Err(PolicyError::Sample(format!(
            "{what} value {at} is {}",
            values[at]
        ))),
        None => Ok(()),
    }
}

/// Rows of `dim` values, each zero-padded to `wide`, as in LeRobot's `pad_vector`.
pub fn widen(rows: &[f32], dim: usize, wide: usize) -> Vec<f32> {
    let zeros = std::iter::repeat_n(0.0, wide - dim);
    rows.chunks_exact(dim)
        .flat_map(|row| row.iter().copied().chain(zeros.clone()))
        .collect()
}
