//! LeRobot's `config.json` of a SmolVLA policy (`SmolVLAConfig` of LeRobot 0.3.3 to 0.6.1), as far as it matters here.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

use serde::de::{Deserializer, MapAccess, Visitor};
use serde::Deserialize;

use crate::config::{ExpertConfig, PolicyConfig};
use crate::error::{Result, StoredPolicyError};
use crate::policy_folder::inference::Normalisation;
use crate::policy_folder::vlm_config::VlmDims;

/// Prefix of image features.
pub const IMAGES: &str = "observation.images.";
const STATE: &str = "observation.state";
const ACTION: &str = "action";

/// LeRobot's description of a policy.
#[derive(Clone, Debug, PartialEq)]
pub struct LeRobotConfig {
    /// Its dimensions.
    pub dims: PolicyConfig,
    /// Camera slots that get blank, masked images when a batch lacks cameras.
    pub empty_cameras: usize,
    /// Euler steps from noise to actions.
    pub num_steps: usize,
    /// The VLM's name on the Hub, or its path during training.
    pub vlm_model_name: String,
    /// LeRobot's name of the states' normalisation, mostly `MEAN_STD`.
    pub state_normalisation: String,
    /// The same for actions.
    pub action_normalisation: String,
}

/// Missing fields have LeRobot's defaults; others are ignored.
#[derive(Deserialize)]
#[serde(default)]
struct PolicyJson {
    #[serde(rename = "type")]
    kind: String,
    input_features: OrderedObject<PolicyFeature>,
    output_features: OrderedObject<PolicyFeature>,
    normalization_mapping: BTreeMap<String, String>,
    chunk_size: usize,
    max_state_dim: usize,
    max_action_dim: usize,
    resize_imgs_with_padding: Option<[usize; 2]>,
    empty_cameras: usize,
    adapt_to_pi_aloha: bool,
    use_delta_joint_actions_aloha: bool,
    tokenizer_max_length: usize,
    num_steps: usize,
    vlm_model_name: String,
    add_image_special_tokens: bool,
    attention_mode: String,
    prefix_length: i64,
    num_expert_layers: i64,
    num_vlm_layers: i64,
    self_attn_every_n_layers: i64,
    expert_width_multiplier: f64,
    min_period: f64,
    max_period: f64,
    /// Ours: the expert's MLP width. LeRobot derives a multiple of 256.
    expert_intermediate_size: Option<usize>,
}

impl Default for PolicyJson {
    fn default() -> Self {
        Self {
            kind: String::new(),
            input_features: OrderedObject(Vec::new()),
            output_features: OrderedObject(Vec::new()),
            normalization_mapping: [
                ("VISUAL", "IDENTITY"),
                ("STATE", "MEAN_STD"),
                ("ACTION", "MEAN_STD"),
            ]
            .map(|(kind, mode)| (kind.into(), mode.into()))
            .into(),
            chunk_size: 50,
            max_state_dim: 32,
            max_action_dim: 32,
            resize_imgs_with_padding: Some([512, 512]),
            empty_cameras: 0,
            adapt_to_pi_aloha: false,
            use_delta_joint_actions_aloha: false,
            tokenizer_max_length: 48,
            num_steps: 10,
            vlm_model_name: "HuggingFaceTB/SmolVLM2-500M-Video-Instruct".into(),
            add_image_special_tokens: false,
            attention_mode: "cross_attn".into(),
            prefix_length: -1,
            num_expert_layers: -1,
            num_vlm_layers: 16,
            self_attn_every_n_layers: 2,
            expert_width_multiplier: 0.75,
            min_period: 4e-3,
            max_period: 4.0,
            expert_intermediate_size: None,
        }
    }
}

#[derive(Deserialize)]
struct PolicyFeature {
    #[serde(rename = "type")]
    kind: String,
    shape: Vec<usize>,
}

/// A JSON object in the written order, which matters for cameras.
struct OrderedObject<V>(Vec<(String, V)>);

impl<'de, V: Deserialize<'de>> Deserialize<'de> for OrderedObject<V> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct Entries<V>(PhantomData<V>);
        impl<'de, V: Deserialize<'de>> Visitor<'de> for Entries<V> {
            type Value = OrderedObject<V>;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("an object")
            }
            fn visit_map<M: MapAccess<'de>>(
                self,
                mut map: M,
            ) -> std::result::Result<Self::Value, M::Error> {
                let mut entries: Vec<(String, V)> = Vec::new();
                while let Some(entry) = map.next_entry::<String, V>()? {
                    if entries.iter().any(|(name, _)| *name == entry.0) {
                        return Err(serde::de::Error::custom(format!(
                            "`{}` is there twice",
                            entry.0
                        )));
                    }
                    entries.push(entry);
                }
                Ok(OrderedObject(entries))
            }
        }
        deserializer.deserialize_map(Entries(PhantomData))
    }
}

impl OrderedObject<PolicyFeature> {
    fn vector_dim(&self, name: &str) -> Result<usize> {
        match self
            .0
            .iter()
            .find(|(n, _)| n == name)
            .map(|(_, f)| f.shape.as_slice())
        {
            Some([dim]) => Ok(*dim),
            Some(shape) => Err(StoredPolicyError::Config(format!(
                "feature `{name}` has shape {shape:?}, one dimension is needed"
            ))),
            None => Err(StoredPolicyError::Config(format!(
                "feature `{name}` is missing"
            ))),
        }
    }
}

/// The expert's MLP width as LeRobot derives it: four times two thirds of the width, up to a multiple of 256.
pub fn default_expert_mlp_width(expert_width: usize) -> usize {
    (4 * (2 * expert_width / 3)).div_ceil(256) * 256
}

impl LeRobotConfig {
    /// Reads the configurations of the policy and its VLM; without the latter, the VLM must be known by name. `expert_intermediate_size`
    /// overrides LeRobot's formula.
    ///
    /// # Errors
    /// [`StoredPolicyError::Config`]: bad JSON, something not implemented, or an unknown VLM.
    pub fn parse(policy_json: &str, vlm_json: Option<&str>) -> Result<Self> {
        let policy: PolicyJson = serde_json::from_str(policy_json)
            .map_err(|e| StoredPolicyError::Config(format!("the policy's JSON: {e}")))?;
        let vlm = match vlm_json {
            Some(json) => VlmDims::parse(json)?,
            None => VlmDims::published(&policy.vlm_model_name).ok_or_else(|| {
                StoredPolicyError::Config(format!(
                    "the VLM `{}` is not known here: put its config.json beside the policy's, as `vlm_config.json`",
                    policy.vlm_model_name
                ))
            })?,
        };
        let (mut text, rms_norm_eps) = (vlm.text, vlm.rms_norm_eps);
        if policy.num_vlm_layers > 0 {
            text.layers = text.layers.min(policy.num_vlm_layers as usize);
        }
        policy.refuse_unsupported(vlm.vision.image_size, text.layers)?;

        let camera_names = policy.camera_names()?;
        // LeRobot truncates the product. Widths are far below 2^53: the cast is exact after `floor`.
        let expert_width = (text.width as f64 * policy.expert_width_multiplier).floor() as usize;
        let dims = PolicyConfig {
            cameras: camera_names.len(),
            vision: vlm.vision,
            expert: ExpertConfig {
                width: expert_width,
                mlp_width: policy
                    .expert_intermediate_size
                    .unwrap_or_else(|| default_expert_mlp_width(expert_width.min(1 << 20))),
            },
            text,
            self_attn_every: policy.self_attn_every(),
            chunk_size: policy.chunk_size,
            state_dim: policy.input_features.vector_dim(STATE)?,
            action_dim: policy.output_features.vector_dim(ACTION)?,
            max_state_dim: policy.max_state_dim,
            max_action_dim: policy.max_action_dim,
            max_language_tokens: policy.tokenizer_max_length,
            min_period: policy.min_period,
            max_period: policy.max_period,
            prefix_length: usize::try_from(policy.prefix_length).unwrap_or(0),
            camera_names,
            rename_map: BTreeMap::new(),
            rms_norm_eps,
        };
        dims.validate()?;
        Ok(Self {
            dims,
            empty_cameras: policy.empty_cameras,
            num_steps: policy.num_steps,
            state_normalisation: policy.normalisation("STATE"),
            action_normalisation: policy.normalisation("ACTION"),
            vlm_model_name: policy.vlm_model_name,
        })
    }

    /// How states and actions are normalised.
    ///
    /// # Errors
    /// [`StoredPolicyError::Config`] for a mode that is not implemented.
    pub fn modes(&self) -> Result<(Normalisation, Normalisation)> {
        Ok((self.mode("STATE", STATE)?, self.mode("ACTION", ACTION)?))
    }

    pub(super) fn mode(&self, kind: &str, feature: &str) -> Result<Normalisation> {
        let mode = match kind {
            "STATE" => &self.state_normalisation,
            _ => &self.action_normalisation,
        };
        Normalisation::named(mode, feature)
    }
}

impl PolicyJson {
    /// Image features in order. LeRobot adds empty cameras' when it builds the policy, and then writes them: they are optional.
    fn camera_names(&self) -> Result<Vec<String>> {
        let visual = self
            .input_features
            .0
            .iter()
            .filter(|(_, f)| f.kind == "VISUAL");
        let mut names: Vec<String> = visual.map(|(name, _)| name.clone()).collect();
        if self.empty_cameras > 256 {
            return Err(StoredPolicyError::Config(format!(
                "`empty_cameras` is {}; 256 are allowed",
                self.empty_cameras
            )));
        }
        for i in 0..self.empty_cameras {
            let name = format!("{IMAGES}empty_camera_{i}");
            if !names.contains(&name) {
                names.push(name);
            }
        }
        Ok(names)
    }

    /// In any attention mode but the crossed one, every layer is joint.
    fn self_attn_every(&self) -> usize {
        if self.attention_mode.contains("cross") {
            usize::try_from(self.self_attn_every_n_layers).unwrap_or(0)
        } else {
            1
        }
    }

    fn normalisation(&self, kind: &str) -> String {
        let mode = self.normalization_mapping.get(kind);
        mode.cloned().unwrap_or_else(|| "IDENTITY".into())
    }

    fn refuse_unsupported(&self, image_size: usize, layers: usize) -> Result<()> {
        let visual = self.normalization_mapping.get("VISUAL");
        let refusals = [
            (self.kind != "smolvla", format!("`type` is `{}`, not `smolvla`", self.kind)),
            (
                self.add_image_special_tokens,
                "`add_image_special_tokens` is not implemented: LeRobot takes the tokens' ids from the VLM's tokenizer, and neither \
                 configuration names them"
                    .into(),
            ),
            (
                self.adapt_to_pi_aloha || self.use_delta_joint_actions_aloha,
                "conversions for Aloha robots are not implemented".into(),
            ),
            (
                self.num_expert_layers > 0 && self.num_expert_layers as usize != layers,
                format!("`num_expert_layers` is {}, only as many as text layers ({layers}) are implemented", self.num_expert_layers),
            ),
            (
                self.resize_imgs_with_padding != Some([image_size, image_size]),
                format!("`resize_imgs_with_padding` is {:?}, it must be the vision tower's [{image_size}, {image_size}]", self.resize_imgs_with_padding),
            ),
            (
                visual.is_some_and(|mode| mode != "IDENTITY"),
                format!("images are normalised by `{}`, only `IDENTITY` is implemented", visual.map_or("", String::as_str)),
            ),
            (
                !(1..=1000).contains(&self.num_steps),
                format!("`num_steps` is {}; it must be in 1..=1000", self.num_steps),
            ),
        ];
        match refusals.into_iter().find(|(refused, _)| *refused) {
            Some((_, why)) => Err(StoredPolicyError::Config(why)),
            None => Ok(()),
        }
    }
}
