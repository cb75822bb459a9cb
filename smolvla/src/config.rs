//! Every dimension of a policy.
//!
//! Field meanings follow LeRobot's `SmolVLAConfig` and transformers' `SmolVLMConfig`
//! ([`PolicyConfig::from_lerobot`] reads both). What never varies between SmolVLA models is a constant
//! here, not a field.

use serde::{Deserialize, Serialize};

use crate::error::{PolicyError, Result};
use crate::layout::policy_layout;

/// Base of the rotary embedding. LeRobot uses 10,000 whatever `rope_theta` says.
pub const ROPE_BASE: f32 = 10_000.0;
/// Epsilon of the published model's RMSNorms ([`PolicyConfig::rms_norm_eps`]).
pub const RMS_NORM_EPS: f64 = 1e-5;
/// Epsilon of the LayerNorms of the vision tower.
pub const LAYER_NORM_EPS: f64 = 1e-6;
/// Colour channels of an image.
pub const CHANNELS: usize = 3;

/// No dimension may exceed this: the published model stays well below it.
const LIMIT: usize = 1 << 17;
/// Nor the number of cameras or layers this.
const COUNT_LIMIT: usize = 256;
/// Nor a fixed prefix this many tokens: SmolLM2 was made for no more.
const PREFIX_LIMIT: usize = 8192;
/// Nor the number of parameters this, four times those of the published model.
const PARAMETER_LIMIT: u128 = 1 << 31;

/// The vision tower (SigLIP).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VisionConfig {
    /// Height and width of the square input, in pixels.
    pub image_size: usize,
    /// Height and width of a patch, in pixels.
    pub patch_size: usize,
    /// Hidden width.
    pub width: usize,
    /// Hidden width of the MLPs.
    pub mlp_width: usize,
    /// Encoder layers.
    pub layers: usize,
    /// Attention heads.
    pub heads: usize,
    /// Pixel-shuffle factor of the connector: `shuffle x shuffle` patches become one token.
    pub shuffle: usize,
}

/// The language layers (SmolLM2), only those that SmolVLA keeps.
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

/// How a layer of the expert meets the prefix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayerKind {
    /// One attention over the prefix's keys and the expert's own, causal among the action tokens.
    Joint,
    /// Attention over the prefix alone, its keys and values passed through the expert's own projections.
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
    /// Layer `i` is [`LayerKind::Joint`] when `i` is a multiple of this, else [`LayerKind::Cross`]; with 0 all layers are the
    /// latter.
    pub self_attn_every: usize,
    /// Action frames predicted at once.
    pub chunk_size: usize,
    /// Real state dimensions of the robot.
    pub state_dim: usize,
    /// Real action dimensions of the robot.
    pub action_dim: usize,
    /// State dimensions of the network; the rest is zero.
    pub max_state_dim: usize,
    /// Action dimensions of the network; the rest is zero.
    pub max_action_dim: usize,
    /// Longest instruction, in tokens.
    pub max_language_tokens: usize,
    /// Shortest period of the time embedding.
    pub min_period: f64,
    /// Longest period of the time embedding.
    pub max_period: f64,
    /// Prefixes are filled up to this many tokens with masked ones; 0 leaves them as long as they are.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub prefix_length: usize,
    /// Names of the camera slots in the order of the prefix (LeRobot's image features), or none: then cameras go by name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub camera_names: Vec<String>,
    /// Epsilon of the RMSNorms of the text layers and of the expert, whose configuration LeRobot copies from theirs.
    #[serde(default = "published_eps", skip_serializing_if = "is_published_eps")]
    pub rms_norm_eps: f64,
}

fn published_eps() -> f64 {
    RMS_NORM_EPS
}

/// A file of the published epsilon does not name it: policy files, and with them a genesis' digests, stay what they were.
fn is_published_eps(eps: &f64) -> bool {
    *eps == RMS_NORM_EPS
}

fn is_zero(number: &usize) -> bool {
    *number == 0
}

impl PolicyConfig {
    /// Kind of the expert's layer `i`.
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

    /// Patches of one image. Pixels that fill no whole patch, at the right and at the bottom, are not read.
    pub fn patches(&self) -> usize {
        let side = self.vision.image_size / self.vision.patch_size;
        side * side
    }

    /// Tokens that one camera adds to the prefix.
    pub fn tokens_per_camera(&self) -> usize {
        self.patches() / (self.vision.shuffle * self.vision.shuffle)
    }

    /// The longest possible prefix: all cameras, the longest instruction, one state token.
    pub fn max_prefix_tokens(&self) -> usize {
        self.cameras * self.tokens_per_camera() + self.max_language_tokens + 1
    }

    /// Elements of one action chunk, padded to the network's action dimensions.
    pub fn chunk_elements(&self) -> usize {
        self.chunk_size * self.max_action_dim
    }

    /// Refuses dimensions that no network can have.
    pub fn validate(&self) -> Result<()> {
        let (v, t, e) = (&self.vision, &self.text, &self.expert);
        let sizes = [
            ("cameras", self.cameras),
            ("vision.image_size", v.image_size),
            ("vision.patch_size", v.patch_size),
            ("vision.width", v.width),
            ("vision.mlp_width", v.mlp_width),
            ("vision.layers", v.layers),
            ("vision.heads", v.heads),
            ("vision.shuffle", v.shuffle),
            ("text.width", t.width),
            ("text.mlp_width", t.mlp_width),
            ("text.layers", t.layers),
            ("text.heads", t.heads),
            ("text.kv_heads", t.kv_heads),
            ("text.head_dim", t.head_dim),
            ("text.vocabulary", t.vocabulary),
            ("expert.width", e.width),
            ("expert.mlp_width", e.mlp_width),
            ("chunk_size", self.chunk_size),
            ("state_dim", self.state_dim),
            ("action_dim", self.action_dim),
            ("max_state_dim", self.max_state_dim),
            ("max_action_dim", self.max_action_dim),
            ("max_language_tokens", self.max_language_tokens),
        ];
        for (name, value) in sizes {
            let counts = name == "cameras" || name.ends_with(".layers");
            let limit = if counts { COUNT_LIMIT } else { LIMIT };
            if value == 0 || value > limit {
                return Err(PolicyError::Config(format!(
                    "`{name}` is {value}; it must be in 1..={limit}"
                )));
            }
        }
        let rules = [
            (
                v.image_size >= v.patch_size,
                "vision.image_size is below vision.patch_size",
            ),
            (
                (v.image_size / v.patch_size).is_multiple_of(v.shuffle),
                "the patch grid's side must be a multiple of vision.shuffle",
            ),
            (
                v.width % v.heads == 0,
                "vision.width must be a multiple of vision.heads",
            ),
            (
                t.heads % t.kv_heads == 0,
                "text.heads must be a multiple of text.kv_heads",
            ),
            (
                t.head_dim % 2 == 0,
                "text.head_dim must be even (rotary embedding)",
            ),
            (
                e.width % 2 == 0 && e.width >= 4,
                "expert.width must be even and at least 4 (time embedding)",
            ),
            (
                self.state_dim <= self.max_state_dim,
                "state_dim exceeds max_state_dim",
            ),
            (
                self.action_dim <= self.max_action_dim,
                "action_dim exceeds max_action_dim",
            ),
            (
                self.min_period > 0.0
                    && self.min_period < self.max_period
                    && self.max_period.is_finite(),
                "periods must satisfy 0 < min_period < max_period",
            ),
            (
                self.rms_norm_eps > 0.0 && self.rms_norm_eps.is_finite(),
                "rms_norm_eps must be above 0",
            ),
            (
                self.self_attn_every <= LIMIT && self.prefix_length <= PREFIX_LIMIT,
                "self_attn_every or prefix_length is far too large",
            ),
            (
                self.camera_names.is_empty() || self.camera_names.len() == self.cameras,
                "camera_names must name every camera slot, or none",
            ),
        ];
        if let Some((_, rule)) = rules.iter().find(|(holds, _)| !holds) {
            return Err(PolicyError::Config((*rule).into()));
        }
        let elements = |shape: &Vec<usize>| shape.iter().map(|d| *d as u128).product::<u128>();
        let parameters: u128 = policy_layout(self).values().map(elements).sum();
        if parameters > PARAMETER_LIMIT {
            return Err(PolicyError::Config(format!(
                "these dimensions make {parameters} parameters; {PARAMETER_LIMIT} are allowed"
            )));
        }
        Ok(())
    }
}
