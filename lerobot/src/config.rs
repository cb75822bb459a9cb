//! Every dimension of a SmolVLA policy.
//!
//! Fields follow LeRobot's `SmolVLAConfig` and transformers' `SmolVLMConfig` ([`LeRobotConfig`](crate::policy_folder::LeRobotConfig) reads
//! both). What all SmolVLA models share is a constant here.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Base of the rotary embedding. LeRobot ignores `rope_theta`.
pub const ROPE_BASE: f32 = 10_000.0;
/// Epsilon of the published model's RMSNorms ([`PolicyConfig::rms_norm_eps`]).
pub const RMS_NORM_EPS: f64 = 1e-5;
/// Epsilon of the vision tower's LayerNorms.
pub const LAYER_NORM_EPS: f64 = 1e-6;
/// Colour channels of an image.
pub const CHANNELS: usize = 3;

/// The vision tower (SigLIP).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VisionConfig {
    /// Height and width of the square input, pixels.
    pub image_size: usize,
    /// Height and width of a patch, pixels.
    pub patch_size: usize,
    /// Hidden width.
    pub width: usize,
    /// Hidden width of the MLPs.
    pub mlp_width: usize,
    /// Encoder layers.
    pub layers: usize,
    /// Attention heads.
    pub heads: usize,
    /// The connector's pixel shuffle: `shuffle x shuffle` patches become one token.
    pub shuffle: usize,
}

/// The language layers (SmolLM2) that SmolVLA keeps.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TextConfig {
    /// Hidden width.
    pub width: usize,
    /// Hidden width of the SwiGLU MLPs.
    pub mlp_width: usize,
    /// Layers kept; the expert has as many.
    pub layers: usize,
    /// Query heads, shared with the expert.
    pub heads: usize,
    /// Key/value heads, shared with the expert.
    pub kv_heads: usize,
    /// Width of a head.
    pub head_dim: usize,
    /// Token ids are below this.
    pub vocabulary: usize,
}

/// The action expert.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpertConfig {
    /// Hidden width.
    pub width: usize,
    /// Hidden width of the SwiGLU MLPs.
    pub mlp_width: usize,
}

/// How an expert layer meets the prefix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayerKind {
    /// One attention over the keys of prefix and expert, causal among the action tokens.
    Joint,
    /// Attention over the prefix alone, its keys and values projected again by the expert.
    Cross,
}

/// All dimensions of one SmolVLA policy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyConfig {
    /// Camera slots.
    pub cameras: usize,
    /// Vision tower and connector.
    pub vision: VisionConfig,
    /// Language layers.
    pub text: TextConfig,
    /// Action expert.
    pub expert: ExpertConfig,
    /// Layer `i` is [`LayerKind::Joint`] if `i` is a multiple of this, else (and for 0) [`LayerKind::Cross`].
    pub self_attn_every: usize,
    /// Action frames predicted at once.
    pub chunk_size: usize,
    /// The robot's state dimensions.
    pub state_dim: usize,
    /// The robot's action dimensions.
    pub action_dim: usize,
    /// State dimensions of the network, padded with zeros.
    pub max_state_dim: usize,
    /// Action dimensions of the network, padded with zeros.
    pub max_action_dim: usize,
    /// Longest instruction, in tokens.
    pub max_language_tokens: usize,
    /// Shortest period of the time embedding.
    pub min_period: f64,
    /// Longest period of the time embedding.
    pub max_period: f64,
    /// Masked tokens fill prefixes up to this length; 0: no filling.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub prefix_length: usize,
    /// Camera slots in the order of the prefix (LeRobot's image features). Where empty, cameras go by name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub camera_names: Vec<String>,
    /// The policy's whole camera name by the recording's, where they differ (LeRobot's `rename_map`).
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub rename_map: BTreeMap<String, String>,
    /// Epsilon of the text layers' RMSNorms and of the expert's, which LeRobot copies.
    #[serde(default = "published_eps", skip_serializing_if = "is_published_eps")]
    pub rms_norm_eps: f64,
}

fn published_eps() -> f64 {
    RMS_NORM_EPS
}

/// The published epsilon is left out of the file, so that a genesis keeps its digests.
fn is_published_eps(eps: &f64) -> bool {
    *eps == RMS_NORM_EPS
}

fn is_zero(number: &usize) -> bool {
    *number == 0
}

impl PolicyConfig {
    /// Kind of expert layer `i`.
    pub fn layer_kind(&self, i: usize) -> LayerKind {
        if self.self_attn_every > 0 && i.is_multiple_of(self.self_attn_every) {
            LayerKind::Joint
        } else {
            LayerKind::Cross
        }
    }

    /// Width of all query heads together.
    pub fn query_width(&self) -> usize {
        self.text.heads * self.text.head_dim
    }

    /// Width of all key (or value) heads together.
    pub fn kv_width(&self) -> usize {
        self.text.kv_heads * self.text.head_dim
    }

    /// Patches of one image. Pixels beyond the last whole patch, right and bottom, are not read.
    pub fn patches(&self) -> usize {
        let side = self.vision.image_size / self.vision.patch_size;
        side * side
    }

    /// Tokens of one camera in the prefix.
    pub fn tokens_per_camera(&self) -> usize {
        self.patches() / (self.vision.shuffle * self.vision.shuffle)
    }

    /// Longest prefix: all cameras, the longest instruction, one state token.
    pub fn max_prefix_tokens(&self) -> usize {
        self.cameras * self.tokens_per_camera() + self.max_language_tokens + 1
    }

    /// Elements of an action chunk, padded to the network's dimensions.
    pub fn chunk_elements(&self) -> usize {
        self.chunk_size * self.max_action_dim
    }
}
