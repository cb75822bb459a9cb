//! Policies of known dimensions, by name.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use zk0_lerobot::config::{ExpertConfig, PolicyConfig, TextConfig, VisionConfig};
use zk0_lerobot::policy_folder::VlmDims;
use zk0_lerobot::StoredPolicyError;

use crate::error::Result;

/// A named set of dimensions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Profile {
    /// The dimensions of the fixture `smolvla_tiny`.
    Tiny,
    /// For a proven evaluation of about two million guest cycles.
    Micro,
    /// The published model (lerobot/smolvla_base) with two cameras on an SO-100 or SO-101.
    Full,
}

impl Profile {
    /// All profiles.
    pub const ALL: [Self; 3] = [Self::Tiny, Self::Micro, Self::Full];

    /// The profile of a name.
    pub fn from_name(name: &str) -> Result<Self> {
        let named = Self::ALL.into_iter().find(|profile| profile.name() == name);
        named.ok_or_else(|| {
            StoredPolicyError::Config(format!(
                "no profile is called `{name}`; there are `tiny`, `micro` and `full`"
            ))
            .into()
        })
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tiny => "tiny",
            Self::Micro => "micro",
            Self::Full => "full",
        }
    }

    /// Its dimensions. Small profiles otherwise follow the published model.
    pub fn config(self) -> PolicyConfig {
        let vision = |(width, mlp_width, heads)| VisionConfig {
            image_size: 64,
            patch_size: 16,
            width,
            mlp_width,
            layers: 2,
            heads,
            shuffle: 2,
        };
        match self {
            Self::Tiny => PolicyConfig {
                vision: vision((48, 96, 3)),
                text: TextConfig {
                    width: 72,
                    mlp_width: 160,
                    layers: 4,
                    heads: 6,
                    kv_heads: 2,
                    head_dim: 12,
                    vocabulary: 128,
                },
                expert: ExpertConfig {
                    width: 54,
                    mlp_width: 256,
                },
                chunk_size: 10,
                ..Self::Full.config()
            },
            Self::Micro => PolicyConfig {
                vision: vision((16, 32, 2)),
                text: TextConfig {
                    width: 16,
                    mlp_width: 32,
                    layers: 2,
                    heads: 2,
                    kv_heads: 1,
                    head_dim: 8,
                    vocabulary: 128,
                },
                expert: ExpertConfig {
                    width: 12,
                    mlp_width: 32,
                },
                chunk_size: 6,
                max_state_dim: 8,
                max_action_dim: 8,
                max_language_tokens: 4,
                ..Self::Full.config()
            },
            Self::Full => {
                let vlm = VlmDims::smolvlm2_500m();
                PolicyConfig {
                    cameras: 2,
                    vision: vlm.vision,
                    text: TextConfig {
                        layers: 16,
                        ..vlm.text
                    },
                    expert: ExpertConfig {
                        width: 720,
                        mlp_width: 2048,
                    },
                    self_attn_every: 2,
                    chunk_size: 50,
                    state_dim: 6,
                    action_dim: 6,
                    max_state_dim: 32,
                    max_action_dim: 32,
                    max_language_tokens: 48,
                    min_period: 0.004,
                    max_period: 4.0,
                    prefix_length: 0,
                    camera_names: Vec::new(),
                    rename_map: BTreeMap::new(),
                    rms_norm_eps: vlm.rms_norm_eps,
                }
            }
        }
    }
}
