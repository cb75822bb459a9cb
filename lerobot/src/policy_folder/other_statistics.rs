//! What differs in a copy of a policy folder with another recording's statistics: it depends on where the source keeps its own.

use std::collections::BTreeMap;

use safetensors::tensor::TensorView;
use serde_json::Value;

use crate::dataset::{Normalizer, Stats};
use crate::error::{Result, StoredPolicyError};
use crate::policy_folder::folder::{PolicyFolder, WEIGHTS};
use crate::policy_folder::inference::Normalisation;
use crate::policy_folder::json_file::read_json;
use crate::policy_folder::statistics::{plain_name, Normalised, ACTION, STATE};
use crate::stored_tensors::StoredTensors;
use zk0_tensors::{Dtype, TensorData, TensorError, TensorSet};

#[derive(Default)]
pub(super) struct OtherStats {
    /// Files that replace or extend the source's.
    pub files: BTreeMap<String, Vec<u8>>,
    /// Tensors that replace or extend the source's weights.
    pub tensors: TensorSet,
}

impl PolicyFolder {
    /// Checks early whether [`PolicyFolder::write_trained`] could put such statistics into a copy.
    ///
    /// # Errors
    /// As there.
    pub fn check_takes(&self, stats: &Stats) -> Result<()> {
        self.other_stats(stats).map(drop)
    }

    pub(super) fn other_stats(&self, stats: &Stats) -> Result<OtherStats> {
        let (modes, dims) = (self.modes()?, &self.config.dims);
        let all = [
            (&STATE, modes.0, &stats.state, dims.state_dim),
            (&ACTION, modes.1, &stats.action, dims.action_dim),
        ];
        // LeRobot ignores statistics of features that are not normalised.
        let used = all.map(|(feature, mode, normalizer, dim)| {
            let used = mode == Normalisation::MeanStd;
            used.then_some((feature, normalizer, dim))
        });
        let mut moments = TensorSet::new();
        for (feature, normalizer, dim) in used.into_iter().flatten() {
            if normalizer.dim() != dim {
                return Err(StoredPolicyError::Statistics {
                    feature: feature.name,
                    expected: dim,
                    found: normalizer.dim(),
                });
            }
            moments.extend(named(feature.name, normalizer));
        }
        let mut other = OtherStats::default();
        if moments.is_empty() {
            return Ok(other);
        }
        for (feature, used) in [&STATE, &ACTION].into_iter().zip(used) {
            if self.steps(feature).is_some() {
                // Both pipelines have both features' statistics, because the first also normalises actions for training.
                self.put_into_pipeline(feature, &moments, &mut other.files)?;
            } else if let Some((_, normalizer, _)) = used {
                let buffers = feature.buffers.iter();
                other
                    .tensors
                    .extend(buffers.flat_map(|name| named(name, normalizer)));
            }
        }
        Ok(other)
    }

    fn put_into_pipeline(
        &self,
        feature: &Normalised,
        moments: &TensorSet,
        files: &mut BTreeMap<String, Vec<u8>>,
    ) -> Result<()> {
        let path = self.folder.join(feature.pipeline);
        let broken = |cause: String| StoredPolicyError::file(&path, cause);
        let mut pipeline: Value =
            serde_json::from_str(&read_json(&path)?).map_err(|e| broken(e.to_string()))?;
        let steps = pipeline.get_mut("steps").and_then(Value::as_array_mut);
        let mut steps = steps.into_iter().flatten().enumerate();
        let step = steps.find_map(|(number, step)| match step {
            Value::Object(step) => {
                let found = step.get("registry_name")?.as_str()? == feature.processor;
                found.then_some((number, step))
            }
            _ => None,
        });
        // Without such a step, nothing is normalised.
        let Some((number, step)) = step else {
            return Ok(());
        };
        if let Some(name) = step.get("state_file").and_then(Value::as_str) {
            let name = plain_name(&path, name)?;
            if name == WEIGHTS {
                return Err(broken(format!(
                    "`state_file` is `{name}`, the policy's weights; statistics are in a file of their own"
                )));
            }
            let source = StoredTensors::open(self.folder.join(name))?;
            files.insert(name.into(), state_file(Some(&source), moments)?);
            return Ok(());
        }
        // The processor was saved before any recording. LeRobot gives this name.
        let stem = feature.pipeline.trim_end_matches(".json");
        let name = format!("{stem}_step_{number}_{}.safetensors", feature.processor);
        step.insert("state_file".into(), name.clone().into());
        let text = serde_json::to_vec_pretty(&pipeline).map_err(|e| broken(e.to_string()))?;
        files.insert(feature.pipeline.into(), text);
        files.insert(name, state_file(None, moments)?);
        Ok(())
    }
}

fn named(name: &str, normalizer: &Normalizer) -> [(String, TensorData); 2] {
    [("mean", normalizer.mean()), ("std", normalizer.std())].map(|(what, values)| {
        let tensor = TensorData {
            shape: vec![values.len()],
            data: values.to_vec(),
        };
        (format!("{name}.{what}"), tensor)
    })
}

/// A processor's state with these moments. The source's other statistics of the same features (minimum, maximum) go; other features' stay.
fn state_file(source: Option<&StoredTensors>, moments: &TensorSet) -> Result<Vec<u8>> {
    let feature = |name: &str| {
        name.rsplit_once('.')
            .map(|(feature, _)| feature.to_string())
    };
    let replaced: Vec<_> = moments.keys().map(|name| feature(name)).collect();
    let mut all = Vec::new();
    if let Some(source) = source {
        for name in source.names() {
            let Some(info) = source.info(&name) else {
                continue;
            };
            if !replaced.contains(&feature(&name)) {
                let (dtype, shape) = (info.dtype, info.shape.clone());
                let mut bytes = Vec::new();
                for block in source.blocks(&name)? {
                    bytes.extend(block?);
                }
                all.push((name, dtype, shape, bytes));
            }
        }
    }
    for (name, tensor) in moments {
        let bytes = tensor.data.iter().flat_map(|x| x.to_le_bytes()).collect();
        all.push((name.clone(), Dtype::F32, tensor.shape.clone(), bytes));
    }
    let failed = |e: safetensors::SafeTensorError| TensorError::Header(e.to_string());
    let views = all.iter().map(|(name, dtype, shape, bytes)| {
        let view = TensorView::new(*dtype, shape.clone(), bytes).map_err(failed)?;
        Ok((name, view))
    });
    let views = views.collect::<Result<Vec<_>>>()?;
    let metadata = source.and_then(|source| source.metadata().clone());
    Ok(safetensors::serialize(views, metadata).map_err(failed)?)
}
