//! A policy folder's two pipelines, read step by step as LeRobot 0.6.1 runs them: `policy_preprocessor.json` makes batches for the network,
//! `policy_postprocessor.json` actions from its output. Steps override `config.json`. Unknown or impossible steps are refused by name.

use std::collections::BTreeMap;
use std::path::Path;

use serde::de::DeserializeOwned;
use serde::Deserialize;
use serde_json::{Map, Value};

use crate::error::{Result, StoredPolicyError};
use crate::policy_folder::inference::Normalisation;
use crate::policy_folder::json_file::read_json;

/// The pipeline before the network.
pub(super) const PREPROCESSOR: &str = "policy_preprocessor.json";
/// The pipeline after it.
pub(super) const POSTPROCESSOR: &str = "policy_postprocessor.json";
/// The step that normalises states and, for training, actions.
pub(super) const NORMALIZER: &str = "normalizer_processor";
/// The step that returns actions in the robot's units.
pub(super) const UNNORMALIZER: &str = "unnormalizer_processor";

/// LeRobot's, for all policies.
const EPSILON: f64 = 1e-8;

/// What both pipelines' steps ask for; `None` where a file is missing (LeRobot 0.3 wrote none).
#[derive(Debug, Default)]
pub(super) struct Processors {
    pub before: Option<Steps>,
    pub behind: Option<Steps>,
}

#[derive(Debug, Default)]
pub(super) struct Steps {
    /// New names of observations by old ones.
    pub renames: BTreeMap<String, String>,
    pub tokenizer: Option<TokenizerStep>,
    pub normalizer: Option<NormalizerStep>,
}

/// `tokenizer_processor`. Its padding does not matter.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TokenizerStep {
    #[serde(rename = "tokenizer_name")]
    pub name: Option<String>,
    #[serde(default = "longest_text")]
    pub max_length: usize,
    #[serde(default = "task")]
    task_key: String,
    #[serde(default = "yes")]
    truncation: bool,
    #[serde(rename = "padding_side")]
    _padding_side: Option<Value>,
    #[serde(rename = "padding")]
    _padding: Option<Value>,
}

/// `normalizer_processor` or `unnormalizer_processor`; `config.json` fills in what it lacks.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NormalizerStep {
    features: Option<BTreeMap<String, ProcessorFeature>>,
    norm_map: Option<BTreeMap<String, String>>,
    normalize_observation_keys: Option<Vec<String>>,
    #[serde(default = "epsilon")]
    eps: f64,
    /// Where its statistics are; `None` if saved before any recording.
    #[serde(skip)]
    pub state_file: Option<String>,
}

#[derive(Debug, Deserialize)]
struct ProcessorFeature {
    #[serde(rename = "type")]
    kind: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RenameStep {
    #[serde(default)]
    rename_map: BTreeMap<String, String>,
}

#[derive(Deserialize)]
struct DeviceStep {
    float_dtype: Option<String>,
}

/// `relative_actions_processor` or `absolute_actions_processor`.
#[derive(Deserialize)]
struct RelativeStep {
    #[serde(default)]
    enabled: bool,
}

#[derive(Deserialize)]
struct Pipeline {
    steps: Vec<ProcessorStep>,
}

#[derive(Deserialize)]
struct ProcessorStep {
    registry_name: Option<String>,
    class: Option<String>,
    #[serde(default)]
    config: Map<String, Value>,
    state_file: Option<String>,
}

fn longest_text() -> usize {
    512
}

fn task() -> String {
    "task".into()
}

fn yes() -> bool {
    true
}

fn epsilon() -> f64 {
    EPSILON
}

impl Processors {
    /// Reads a policy folder's pipelines.
    ///
    /// # Errors
    /// [`StoredPolicyError::AtPath`]: a file is not a pipeline, or a step needs something that is not implemented.
    pub fn read(folder: &Path) -> Result<Self> {
        let steps = |name: &str| -> Result<Option<Steps>> {
            let path = folder.join(name);
            if !path.exists() {
                return Ok(None);
            }
            let read = read_json(&path)?;
            let read = Steps::parse(&read, name == PREPROCESSOR);
            read.map(Some)
                .map_err(|cause| StoredPolicyError::file(&path, cause))
        };
        Ok(Self {
            before: steps(PREPROCESSOR)?,
            behind: steps(POSTPROCESSOR)?,
        })
    }
}

impl Steps {
    fn parse(json: &str, is_before: bool) -> std::result::Result<Self, String> {
        let pipeline: Pipeline = serde_json::from_str(json).map_err(|e| e.to_string())?;
        let mut steps = Self::default();
        let mut ends_lines = false;
        for step in pipeline.steps {
            let name = step.registry_name.as_deref().or(step.class.as_deref());
            let name = name.ok_or("has a step without `registry_name`")?.to_owned();
            match (&name[..], is_before) {
                ("rename_observations_processor", true) => {
                    steps.rename(step.config::<RenameStep>(&name)?.rename_map)?
                }
                ("smolvla_new_line_processor", true) => ends_lines = true,
                ("tokenizer_processor", true) => {
                    let tokenizer: TokenizerStep = step.config(&name)?;
                    tokenizer.check(ends_lines)?;
                    once(&name, steps.tokenizer.replace(tokenizer))?;
                }
                (NORMALIZER, true) | (UNNORMALIZER, false) => {
                    let normalizer: NormalizerStep = step.config(&name)?;
                    normalizer.check(&name)?;
                    let state_file = step.state_file;
                    let normalizer = NormalizerStep { state_file, ..normalizer };
                    once(&name, steps.normalizer.replace(normalizer))?;
                }
                ("relative_actions_processor", true) | ("absolute_actions_processor", false) => {
                    if step.config::<RelativeStep>(&name)?.enabled {
                        return Err(format!(
                            "step `{name}` is enabled: LeRobot trains this policy on actions relative to the state, which is not \
                             implemented here; take a policy that acts in absolute positions"
                        ));
                    }
                }
                ("device_processor", _) => match step.config::<DeviceStep>(&name)?.float_dtype {
                    None => {}
                    Some(dtype) if dtype == "float32" => {}
                    Some(dtype) => {
                        return Err(format!(
                            "step `{name}` converts numbers to `{dtype}`; only float32 is implemented"
                        ))
                    }
                },
                ("to_batch_processor", true) => {}
                _ => {
                    return Err(format!(
                        "step `{name}` is not known here: zk0 reads the steps that LeRobot 0.6.1 writes for SmolVLA, and cannot leave out \
                         another one"
                    ))
                }
            }
        }
        Ok(steps)
    }

    fn rename(&mut self, map: BTreeMap<String, String>) -> std::result::Result<(), String> {
        for (old, new) in &map {
            check_rename(old, new)?;
        }
        for new in self.renames.values_mut() {
            if let Some(newer) = map.get(new) {
                new.clone_from(newer);
            }
        }
        for (old, new) in map {
            self.renames.entry(old).or_insert(new);
        }
        Ok(())
    }
}

/// Refuses a rename of no camera: LeRobot would rename nothing, or exchange what is not a picture.
fn check_rename(old: &str, new: &str) -> std::result::Result<(), String> {
    const PICTURE: &str = "observation.image";
    match [old, new].into_iter().find(|name| !name.starts_with(PICTURE)) {
        None => Ok(()),
        Some(name) => Err(format!(
            "`rename_map` renames `{old}` to `{new}`, and `{name}` is not the whole name of a camera, such as observation.images.top: \
             only cameras are renamed here"
        )),
    }
}

fn once<T>(name: &str, earlier: Option<T>) -> std::result::Result<(), String> {
    match earlier {
        None => Ok(()),
        Some(_) => Err(format!("has the step `{name}` twice")),
    }
}

impl ProcessorStep {
    fn config<T: DeserializeOwned>(&self, name: &str) -> std::result::Result<T, String> {
        let config = Value::Object(self.config.clone());
        serde_json::from_value(config).map_err(|e| format!("step `{name}`: {e}"))
    }
}

impl TokenizerStep {
    fn check(&self, ends_lines: bool) -> std::result::Result<(), String> {
        let refusals = [
            (
                !ends_lines,
                "step `tokenizer_processor` has no `smolvla_new_line_processor` before it; instructions without a line break at \
                 their end are not implemented"
                    .to_owned(),
            ),
            (
                self.task_key != "task",
                format!("step `tokenizer_processor` reads `{}`; only `task` is implemented", self.task_key),
            ),
            (
                !self.truncation,
                "step `tokenizer_processor` does not cut long instructions off, which is not implemented".into(),
            ),
        ];
        first(refusals)
    }
}

impl NormalizerStep {
    fn check(&self, name: &str) -> std::result::Result<(), String> {
        let pictures = self.norm_map.as_ref().and_then(|map| map.get("VISUAL"));
        let refusals = [
            (
                self.eps != EPSILON,
                format!(
                    "step `{name}` has `eps` {}; only {EPSILON:e} is implemented",
                    self.eps
                ),
            ),
            (
                pictures.is_some_and(|mode| mode != "IDENTITY"),
                format!(
                    "step `{name}` normalises images by `{}`; only `IDENTITY` is implemented",
                    pictures.map_or("", String::as_str)
                ),
            ),
        ];
        first(refusals)
    }

    /// How this step normalises a feature that LeRobot counts as `kind`; `None` where `config.json` decides.
    ///
    /// # Errors
    /// A mode that is not implemented.
    pub fn mode(&self, feature: &str, kind: &str) -> Result<Option<Normalisation>> {
        // LeRobot normalises actions whether the step lists them or not.
        let is_action = kind == "ACTION";
        let listed = self.features.as_ref().map(|all| all.get(feature));
        let chosen = self.normalize_observation_keys.as_ref();
        let is_left_out = matches!(listed, Some(None))
            || chosen.is_some_and(|keys| keys.iter().all(|key| key != feature));
        if is_left_out && !is_action {
            return Ok(Some(Normalisation::Identity));
        }
        let Some(modes) = &self.norm_map else {
            return Ok(None);
        };
        let kind = match listed.flatten() {
            Some(feature) if !is_action => &feature.kind,
            _ => kind,
        };
        let mode = modes.get(kind).map_or("IDENTITY", String::as_str);
        Normalisation::named(mode, feature).map(Some)
    }
}

fn first<const N: usize>(refusals: [(bool, String); N]) -> std::result::Result<(), String> {
    match refusals.into_iter().find(|(refused, _)| *refused) {
        Some((_, why)) => Err(why),
        None => Ok(()),
    }
}
