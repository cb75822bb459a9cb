//! Reads LeRobot's `policy_config.json` (as `config.json` of a checkpoint) and the VLM's configuration.

use std::collections::BTreeMap;

use serde::Deserialize;

use crate::config::{
    ExpertConfig, PolicyConfig, TextConfig, VisionConfig, CHANNELS, LAYER_NORM_EPS, RMS_NORM_EPS,
};
use crate::error::{PolicyError, Result};

#[derive(Deserialize)]
struct Feature {
    #[serde(rename = "type")]
    kind: String,
    shape: Vec<usize>,
}

#[derive(Deserialize)]
struct PolicyJson {
    #[serde(rename = "type")]
    kind: String,
    input_features: BTreeMap<String, Feature>,
    output_features: BTreeMap<String, Feature>,
    chunk_size: usize,
    max_state_dim: usize,
    max_action_dim: usize,
    resize_imgs_with_padding: Option<[usize; 2]>,
    #[serde(default)]
    empty_cameras: usize,
    tokenizer_max_length: usize,
    attention_mode: String,
    #[serde(default)]
    add_image_special_tokens: bool,
    prefix_length: i64,
    num_expert_layers: i64,
    num_vlm_layers: i64,
    self_attn_every_n_layers: i64,
    expert_width_multiplier: f64,
    min_period: f64,
    max_period: f64,
    /// Ours: the expert's MLP width. LeRobot derives it, always a multiple of 256.
    expert_intermediate_size: Option<usize>,
}

#[derive(Deserialize)]
struct VlmJson {
    vision_config: VisionJson,
    text_config: TextJson,
    scale_factor: usize,
}

#[derive(Deserialize)]
struct VisionJson {
    hidden_size: usize,
    intermediate_size: usize,
    num_hidden_layers: usize,
    num_attention_heads: usize,
    #[serde(default = "channels")]
    num_channels: usize,
    patch_size: usize,
    image_size: usize,
    #[serde(default = "layer_norm_eps")]
    layer_norm_eps: f64,
}

#[derive(Deserialize)]
struct TextJson {
    vocab_size: usize,
    hidden_size: usize,
    intermediate_size: usize,
    num_hidden_layers: usize,
    num_attention_heads: usize,
    num_key_value_heads: usize,
    head_dim: Option<usize>,
    #[serde(default = "rms_norm_eps")]
    rms_norm_eps: f64,
}

fn channels() -> usize {
    CHANNELS
}

fn layer_norm_eps() -> f64 {
    LAYER_NORM_EPS
}

fn rms_norm_eps() -> f64 {
    RMS_NORM_EPS
}

/// The expert's MLP width as LeRobot derives it: four times two thirds of the width, up to a multiple of 256.
pub fn default_expert_mlp_width(expert_width: usize) -> usize {
    (4 * (2 * expert_width / 3)).div_ceil(256) * 256
}

impl PolicyConfig {
    /// Reads the two files that describe a LeRobot SmolVLA: the policy's configuration and that of the VLM
    /// it is built on. An `expert_intermediate_size` in the former overrides LeRobot's formula.
    ///
    /// # Errors
    /// [`PolicyError::Config`] when a file is not JSON of that form, or asks for something that is not
    /// implemented here.
    pub fn from_lerobot(policy_json: &str, vlm_json: &str) -> Result<Self> {
        let policy: PolicyJson = serde_json::from_str(policy_json)
            .map_err(|e| PolicyError::Config(format!("the policy's JSON: {e}")))?;
        let vlm: VlmJson = serde_json::from_str(vlm_json)
            .map_err(|e| PolicyError::Config(format!("the VLM's JSON: {e}")))?;
        let layers = match usize::try_from(policy.num_vlm_layers) {
            Ok(n) if n > 0 => n.min(vlm.text_config.num_hidden_layers),
            _ => vlm.text_config.num_hidden_layers,
        };
        refuse_unsupported(&policy, &vlm, layers)?;

        let cameras = policy
            .input_features
            .values()
            .filter(|f| f.kind == "VISUAL")
            .count()
            + policy.empty_cameras;
        let (vision, text) = (vlm.vision_config, vlm.text_config);
        let head_dim = match (text.head_dim, text.num_attention_heads) {
            (Some(dim), _) => dim,
            (None, 0) => 0, // refused below, by name
            (None, heads) => text.hidden_size / heads,
        };
        // LeRobot truncates the product; widths are far below 2^53, so the cast is exact after `floor`.
        let expert_width =
            (text.hidden_size as f64 * policy.expert_width_multiplier).floor() as usize;
        let config = PolicyConfig {
            cameras,
            vision: VisionConfig {
                image_size: vision.image_size,
                patch_size: vision.patch_size,
                width: vision.hidden_size,
                mlp_width: vision.intermediate_size,
                layers: vision.num_hidden_layers,
                heads: vision.num_attention_heads,
                shuffle: vlm.scale_factor,
            },
            text: TextConfig {
                width: text.hidden_size,
                mlp_width: text.intermediate_size,
                layers,
                heads: text.num_attention_heads,
                kv_heads: text.num_key_value_heads,
                head_dim,
                vocabulary: text.vocab_size,
            },
            expert: ExpertConfig {
                width: expert_width,
                mlp_width: policy
                    .expert_intermediate_size
                    .unwrap_or_else(|| default_expert_mlp_width(expert_width.min(1 << 20))),
            },
            self_attn_every: usize::try_from(policy.self_attn_every_n_layers).unwrap_or(0),
            chunk_size: policy.chunk_size,
            state_dim: vector_dim(&policy.input_features, "observation.state")?,
            action_dim: vector_dim(&policy.output_features, "action")?,
            max_state_dim: policy.max_state_dim,
            max_action_dim: policy.max_action_dim,
            max_language_tokens: policy.tokenizer_max_length,
            min_period: policy.min_period,
            max_period: policy.max_period,
        };
        config.validate()?;
        Ok(config)
    }
}

fn vector_dim(features: &BTreeMap<String, Feature>, name: &str) -> Result<usize> {
    match features.get(name).map(|f| f.shape.as_slice()) {
        Some([dim]) => Ok(*dim),
        Some(shape) => Err(PolicyError::Config(format!(
            "feature `{name}` has shape {shape:?}, one dimension is needed"
        ))),
        None => Err(PolicyError::Config(format!("feature `{name}` is missing"))),
    }
}

fn refuse_unsupported(policy: &PolicyJson, vlm: &VlmJson, layers: usize) -> Result<()> {
    let size = vlm.vision_config.image_size;
    let refusals = [
        (policy.kind != "smolvla", format!("`type` is `{}`, not `smolvla`", policy.kind)),
        (
            policy.attention_mode != "cross_attn",
            format!("`attention_mode` is `{}`, only `cross_attn` is implemented", policy.attention_mode),
        ),
        (policy.add_image_special_tokens, "`add_image_special_tokens` is not implemented".into()),
        (policy.prefix_length > 0, "a fixed `prefix_length` is not implemented".into()),
        (
            policy.num_expert_layers > 0 && policy.num_expert_layers as usize != layers,
            format!("`num_expert_layers` is {}, only as many as text layers ({layers}) are implemented", policy.num_expert_layers),
        ),
        (
            policy.resize_imgs_with_padding != Some([size, size]),
            format!("`resize_imgs_with_padding` is {:?}, it must be the vision tower's [{size}, {size}]", policy.resize_imgs_with_padding),
        ),
        (vlm.vision_config.num_channels != CHANNELS, "images must have 3 channels".into()),
        (vlm.vision_config.layer_norm_eps != LAYER_NORM_EPS, format!("`layer_norm_eps` must be {LAYER_NORM_EPS}")),
        (vlm.text_config.rms_norm_eps != RMS_NORM_EPS, format!("`rms_norm_eps` must be {RMS_NORM_EPS}")),
    ];
    match refusals.into_iter().find(|(refused, _)| *refused) {
        Some((_, why)) => Err(PolicyError::Config(why)),
        None => Ok(()),
    }
}
