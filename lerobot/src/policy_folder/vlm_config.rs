//! The dimensions of a policy's vision-language model, from transformers' `SmolVLMConfig` or by name.

use serde::Deserialize;

use crate::config::{TextConfig, VisionConfig, CHANNELS, LAYER_NORM_EPS, RMS_NORM_EPS};
use crate::error::{Result, StoredPolicyError};

const SMOLVLM2_500M: &str = "HuggingFaceTB/SmolVLM2-500M-Video-Instruct";

/// A vision-language model with all its language layers.
#[derive(Clone, Debug, PartialEq)]
pub struct VlmDims {
    /// Vision tower and connector.
    pub vision: VisionConfig,
    /// All language layers.
    pub text: TextConfig,
    /// Epsilon of their norms.
    pub rms_norm_eps: f64,
}

impl VlmDims {
    /// SmolVLM2 500M, the published SmolVLA's base. SmolVLA keeps its first 16 language layers.
    pub fn smolvlm2_500m() -> Self {
        Self {
            vision: VisionConfig {
                image_size: 512,
                patch_size: 16,
                width: 768,
                mlp_width: 3072,
                layers: 12,
                heads: 12,
                shuffle: 4,
            },
            text: TextConfig {
                width: 960,
                mlp_width: 2560,
                layers: 32,
                heads: 15,
                kv_heads: 5,
                head_dim: 64,
                vocabulary: 49_280,
            },
            rms_norm_eps: RMS_NORM_EPS,
        }
    }

    /// A published model by its name on the Hub; `None` if unknown here.
    pub fn published(name: &str) -> Option<Self> {
        (name == SMOLVLM2_500M).then(Self::smolvlm2_500m)
    }

    /// Reads a `SmolVLMConfig`; missing fields have transformers' defaults.
    ///
    /// # Errors
    /// [`StoredPolicyError::Config`] for bad JSON, or something that is not implemented.
    pub fn parse(json: &str) -> Result<Self> {
        let vlm: VlmJson = serde_json::from_str(json)
            .map_err(|e| StoredPolicyError::Config(format!("the VLM's JSON: {e}")))?;
        refuse_unsupported(&vlm)?;
        let (vision, text) = (vlm.vision_config, vlm.text_config);
        let head_dim = match (text.head_dim, text.num_attention_heads) {
            (Some(dim), _) => dim,
            (None, 0) => 0, // refused by name when the whole configuration is checked
            (None, heads) => text.hidden_size / heads,
        };
        Ok(Self {
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
                layers: text.num_hidden_layers,
                heads: text.num_attention_heads,
                kv_heads: text.num_key_value_heads.unwrap_or(text.num_attention_heads),
                head_dim,
                vocabulary: text.vocab_size,
            },
            rms_norm_eps: text.rms_norm_eps,
        })
    }
}

#[derive(Deserialize)]
struct VlmJson {
    vision_config: VisionJson,
    text_config: TextJson,
    #[serde(default = "default_scale_factor")]
    scale_factor: usize,
}

fn default_scale_factor() -> usize {
    2
}

#[derive(Deserialize)]
#[serde(default)]
struct VisionJson {
    hidden_size: usize,
    intermediate_size: usize,
    num_hidden_layers: usize,
    num_attention_heads: usize,
    num_channels: usize,
    patch_size: usize,
    image_size: usize,
    layer_norm_eps: f64,
    hidden_act: String,
}

impl Default for VisionJson {
    /// `SmolVLMVisionConfig`'s.
    fn default() -> Self {
        Self {
            hidden_size: 1152,
            intermediate_size: 3072,
            num_hidden_layers: 12,
            num_attention_heads: 16,
            num_channels: CHANNELS,
            patch_size: 32,
            image_size: 224,
            layer_norm_eps: LAYER_NORM_EPS,
            hidden_act: "gelu_pytorch_tanh".into(),
        }
    }
}

#[derive(Deserialize)]
struct TextJson {
    vocab_size: usize,
    hidden_size: usize,
    intermediate_size: usize,
    num_hidden_layers: usize,
    num_attention_heads: usize,
    num_key_value_heads: Option<usize>,
    head_dim: Option<usize>,
    #[serde(default = "llama_rms_norm_eps")]
    rms_norm_eps: f64,
    #[serde(default = "silu")]
    hidden_act: String,
    #[serde(default)]
    attention_bias: bool,
    #[serde(default)]
    mlp_bias: bool,
}

/// `LlamaConfig`'s default; the published SmolVLM's file has its own value.
fn llama_rms_norm_eps() -> f64 {
    1e-6
}

fn silu() -> String {
    "silu".into()
}

fn refuse_unsupported(vlm: &VlmJson) -> Result<()> {
    let (vision, text) = (&vlm.vision_config, &vlm.text_config);
    let refusals = [
        (
            vision.num_channels != CHANNELS,
            format!(
                "`num_channels` is {}, images must have {CHANNELS}",
                vision.num_channels
            ),
        ),
        (
            vision.layer_norm_eps != LAYER_NORM_EPS,
            format!(
                "`layer_norm_eps` is {}, only {LAYER_NORM_EPS} is implemented",
                vision.layer_norm_eps
            ),
        ),
        (
            vision.hidden_act != "gelu_pytorch_tanh",
            format!(
                "the vision tower's `hidden_act` is `{}`, only `gelu_pytorch_tanh` is implemented",
                vision.hidden_act
            ),
        ),
        (
            text.hidden_act != "silu",
            format!(
                "the language model's `hidden_act` is `{}`, only `silu` is implemented",
                text.hidden_act
            ),
        ),
        (
            text.attention_bias || text.mlp_bias,
            "language layers with biases are not implemented".into(),
        ),
    ];
    match refusals.into_iter().find(|(refused, _)| *refused) {
        Some((_, why)) => Err(StoredPolicyError::Config(format!("the VLM's JSON: {why}"))),
        None => Ok(()),
    }
}
