//! The dimensions that policies can have.

use crate::config::PolicyConfig;
use crate::error::{Result, StoredPolicyError};
use crate::layout::policy_layout;

/// The largest dimension, well above the published model's.
const LIMIT: usize = 1 << 17;
/// Most cameras or layers.
const COUNT_LIMIT: usize = 256;
/// Most tokens of a fixed prefix, SmolLM2's maximum.
const PREFIX_LIMIT: usize = 8192;
/// Most parameters: four times the published model's.
const PARAMETER_LIMIT: u128 = 1 << 31;

impl PolicyConfig {
    /// Refuses impossible dimensions.
    ///
    /// # Errors
    /// [`StoredPolicyError::Config`] names the dimension or the rule.
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
                return Err(StoredPolicyError::Config(format!(
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
            (
                self.rename_map.len() <= COUNT_LIMIT
                    && (self.rename_map.is_empty() || !self.camera_names.is_empty()),
                "rename_map renames far too many cameras, or cameras of a policy that names none",
            ),
        ];
        if let Some((_, rule)) = rules.iter().find(|(holds, _)| !holds) {
            return Err(StoredPolicyError::Config((*rule).into()));
        }
        let elements = |shape: &Vec<usize>| shape.iter().map(|d| *d as u128).product::<u128>();
        let parameters: u128 = policy_layout(self).values().map(elements).sum();
        if parameters > PARAMETER_LIMIT {
            return Err(StoredPolicyError::Config(format!(
                "these dimensions make {parameters} parameters; {PARAMETER_LIMIT} are allowed"
            )));
        }
        Ok(())
    }
}
