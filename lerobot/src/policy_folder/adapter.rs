//! A LoRA adapter by PEFT's `save_pretrained`: `adapter_config.json` names the base policy, and `adapter_model.safetensors` has two small
//! matrices A and B for some of its matrices W. The policy has W + scale · B · A.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use hf_hub::Cache;
use serde::Deserialize;
use serde_json::Value;

use crate::error::{Result, StoredPolicyError};
use crate::hub::HubOptions;
use crate::policy_folder::json_file::read_json;
use crate::stored_tensors::StoredTensors;
use zk0_tensors::{TensorData, TensorError};

pub(super) const ADAPTER_FILES: [&str; 2] = ["adapter_config.json", "adapter_model.safetensors"];
/// How PEFT's names begin.
const PREFIX: &str = "base_model.model.";
const RANK_LIMIT: usize = 4096;

#[derive(Debug)]
pub(super) struct Adapter {
    /// The base's weights file.
    pub base: PathBuf,
    scale: f32,
    file: StoredTensors,
    /// Each adapted matrix' rank, by name.
    ranks: BTreeMap<String, usize>,
}

#[derive(Deserialize)]
struct AdapterConfig {
    peft_type: String,
    base_model_name_or_path: Option<String>,
    r: usize,
    lora_alpha: f32,
    #[serde(default)]
    use_rslora: bool,
    /// The rest: anything set here that is not implemented is refused.
    #[serde(flatten)]
    more: BTreeMap<String, Value>,
}

/// Settings that are not implemented.
const REFUSED: [&str; 12] = [
    "use_dora",
    "use_bdlora",
    "use_qalora",
    "lora_bias",
    "fan_in_fan_out",
    "rank_pattern",
    "alpha_pattern",
    "modules_to_save",
    "target_parameters",
    "trainable_token_indices",
    "layer_replication",
    "alora_invocation_tokens",
];

impl Adapter {
    /// Opens the adapter in `folder`; `None` where there is none, or the folder has its own weights.
    ///
    /// # Errors
    /// [`StoredPolicyError::AtPath`]: it is unreadable or not implemented, or its base is not on this machine.
    pub fn open(folder: &Path, weights: &str) -> Result<Option<Self>> {
        let [config, file] = ADAPTER_FILES.map(|name| folder.join(name));
        if !config.exists() || folder.join(weights).exists() {
            return Ok(None);
        }
        let wrong = |cause: String| StoredPolicyError::file(&config, cause);
        let parsed: AdapterConfig =
            serde_json::from_str(&read_json(&config)?).map_err(|e| wrong(e.to_string()))?;
        parsed.check().map_err(wrong)?;
        let name = parsed
            .base_model_name_or_path
            .as_deref()
            .unwrap_or_default();
        let base = find_base(name, weights).ok_or_else(|| {
            wrong(format!(
                "the folder holds a LoRA adapter of the policy `{name}`, which is neither a folder here nor in the Hub's cache. LeRobot loads \
                 both. Run `hf download {name}`, or write the path of its folder as `base_model_name_or_path`"
            ))
        })?;
        let rank = parsed.r as f32;
        let mut adapter = Self {
            base,
            scale: parsed.lora_alpha / if parsed.use_rslora { rank.sqrt() } else { rank },
            file: StoredTensors::open(file)?,
            ranks: BTreeMap::new(),
        };
        for name in adapter.file.names() {
            let module = name.strip_prefix(PREFIX).and_then(|name| {
                let sides = [".lora_A.weight", ".lora_B.weight"];
                sides.iter().find_map(|side| name.strip_suffix(side))
            });
            let Some(module) = module else {
                let error = StoredPolicyError::from(TensorError::Unexpected(name));
                return Err(error.within(adapter.file.path()));
            };
            adapter.ranks.insert(format!("{module}.weight"), parsed.r);
        }
        Ok(Some(adapter))
    }

    pub fn adapts(&self, name: &str) -> bool {
        self.ranks.contains_key(name)
    }

    pub fn names(&self) -> impl Iterator<Item = &String> {
        self.ranks.keys()
    }

    /// Turns the base's matrix `name` into the policy's.
    pub fn apply(&self, name: &str, matrix: &mut TensorData) -> Result<()> {
        let (Some(&rank), &[rows, columns]) = (self.ranks.get(name), &matrix.shape[..]) else {
            return Ok(());
        };
        let module = name.strip_suffix(".weight").unwrap_or(name);
        let side = |side: &str, shape: [usize; 2]| -> Result<Vec<f32>> {
            let name = format!("{PREFIX}{module}.{side}.weight");
            let tensor = self.file.read(&name)?;
            let fits = tensor.check_shape(&name, &shape);
            fits.map_err(|e| StoredPolicyError::from(e).within(self.file.path()))?;
            Ok(tensor.data)
        };
        let (a, b) = (
            side("lora_A", [rank, columns])?,
            side("lora_B", [rows, rank])?,
        );
        let mut delta = vec![0.0f32; columns];
        for (row, weights) in matrix.data.chunks_mut(columns).zip(b.chunks(rank)) {
            delta.fill(0.0);
            for (weight, a) in weights.iter().zip(a.chunks(columns)) {
                delta
                    .iter_mut()
                    .zip(a)
                    .for_each(|(sum, a)| *sum += weight * a);
            }
            row.iter_mut()
                .zip(&delta)
                .for_each(|(w, d)| *w += self.scale * d);
        }
        zk0_tensors::check_finite(name, &matrix.data)
            .map_err(|e| StoredPolicyError::from(e).within(self.file.path()))
    }
}

impl AdapterConfig {
    fn check(&self) -> std::result::Result<(), String> {
        if self.peft_type != "LORA" {
            return Err(format!(
                "`peft_type` is `{}`; only `LORA` is implemented",
                self.peft_type
            ));
        }
        if !(1..=RANK_LIMIT).contains(&self.r) {
            return Err(format!("`r` is {}; it must be in 1..={RANK_LIMIT}", self.r));
        }
        let bias = self.more.get("bias").and_then(Value::as_str);
        if let Some(bias) = bias.filter(|bias| *bias != "none") {
            return Err(format!("`bias` is `{bias}`; only `none` is implemented"));
        }
        let asked = REFUSED
            .iter()
            .find(|key| self.more.get(**key).is_some_and(is_set));
        match asked {
            Some(key) => Err(format!(
                "`{key}` is {}, which is not implemented: merge the adapter into its base with PEFT's merge_and_unload(), and name the folder \
                 that LeRobot's save_pretrained() then writes",
                self.more[*key]
            )),
            None => Ok(()),
        }
    }
}

fn is_set(value: &Value) -> bool {
    match value {
        Value::Null | Value::Bool(false) => false,
        Value::Array(all) => !all.is_empty(),
        Value::Object(all) => !all.is_empty(),
        Value::Bool(true) | Value::Number(_) | Value::String(_) => true,
    }
}

/// The base's weights, in a folder of this name or in the Hub's cache.
fn find_base(name: &str, weights: &str) -> Option<PathBuf> {
    let beside = Path::new(name).join(weights);
    if !name.is_empty() && beside.exists() {
        return Some(beside);
    }
    let cache = HubOptions::from_env().ok()?.cache;
    Cache::new(cache).model(name.into()).get(weights)
}
