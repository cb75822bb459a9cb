//! Prepared samples as tensors: a bank on the device that batches are picked from.

use candle_core::{Device, Tensor};

use crate::config::PolicyConfig;
use crate::error::{PolicyError, Result};
use crate::model::prefix::PrefixCache;
use crate::sample::PreparedSample;

/// All samples of a run on the device. Shorter prefixes are filled up and masked.
pub struct SampleBank {
    keys: Vec<Tensor>,
    values: Vec<Tensor>,
    valid: Vec<Vec<bool>>,
    actions: Tensor,
    is_pad: Vec<Vec<bool>>,
}

/// Some samples of a bank, in a chosen order.
pub struct Batch {
    /// Their prefix.
    pub cache: PrefixCache,
    /// (B, chunk, max_action_dim).
    pub actions: Tensor,
    /// B rows of chunk.
    pub is_pad: Vec<Vec<bool>>,
}

impl SampleBank {
    /// Copies samples to a device.
    ///
    /// # Errors
    /// [`PolicyError::Sample`] when there is none, or one does not fit the policy or holds a value that is not finite.
    pub fn new(
        config: &PolicyConfig,
        samples: &[&PreparedSample],
        device: &Device,
    ) -> Result<Self> {
        if samples.is_empty() {
            return Err(PolicyError::Sample("there are no samples".into()));
        }
        for (i, sample) in samples.iter().enumerate() {
            check(config, sample)
                .map_err(|what| PolicyError::Sample(format!("sample {i}: {what}")))?;
        }
        let longest = samples.iter().map(|s| s.prefix_tokens).max().unwrap_or(0);
        let layers = |pick: fn(&PreparedSample) -> &Vec<Vec<f32>>| -> Result<Vec<Tensor>> {
            (0..config.text.layers)
                .map(|layer| {
                    let mut all = Vec::with_capacity(samples.len() * longest * config.kv_width());
                    for (i, sample) in samples.iter().enumerate() {
                        all.extend_from_slice(&pick(sample)[layer]);
                        all.resize((i + 1) * longest * config.kv_width(), 0.0);
                    }
                    let shape = (
                        samples.len(),
                        longest,
                        config.text.kv_heads,
                        config.text.head_dim,
                    );
                    Ok(Tensor::from_vec(all, shape, device)?)
                })
                .collect()
        };
        let actions: Vec<f32> = samples
            .iter()
            .flat_map(|s| s.actions.iter().copied())
            .collect();
        Ok(Self {
            keys: layers(|s| &s.keys)?,
            values: layers(|s| &s.values)?,
            valid: samples
                .iter()
                .map(|s| (0..longest).map(|k| k < s.prefix_tokens).collect())
                .collect(),
            actions: Tensor::from_vec(
                actions,
                (samples.len(), config.chunk_size, config.max_action_dim),
                device,
            )?,
            is_pad: samples.iter().map(|s| s.is_pad.clone()).collect(),
        })
    }

    /// Samples in the bank.
    pub fn len(&self) -> usize {
        self.is_pad.len()
    }

    /// Whether there are none; [`Self::new`] refuses that, so this is `false`.
    pub fn is_empty(&self) -> bool {
        self.is_pad.is_empty()
    }

    /// The samples at `indices`, each below [`Self::len`].
    pub fn batch(&self, indices: &[usize]) -> Result<Batch> {
        if let Some(i) = indices.iter().find(|i| **i >= self.len()) {
            return Err(PolicyError::Sample(format!(
                "there is no sample {i} among {}",
                self.len()
            )));
        }
        let picked = Tensor::from_iter(indices.iter().map(|i| *i as u32), self.actions.device())?;
        let pick = |layers: &[Tensor]| -> Result<Vec<Tensor>> {
            layers
                .iter()
                .map(|layer| Ok(layer.index_select(&picked, 0)?))
                .collect()
        };
        Ok(Batch {
            cache: PrefixCache {
                keys: pick(&self.keys)?,
                values: pick(&self.values)?,
                valid: indices.iter().map(|i| self.valid[*i].clone()).collect(),
            },
            actions: self.actions.index_select(&picked, 0)?,
            is_pad: indices.iter().map(|i| self.is_pad[*i].clone()).collect(),
        })
    }
}

fn check(config: &PolicyConfig, sample: &PreparedSample) -> std::result::Result<(), String> {
    if !(1..=config.max_prefix_tokens()).contains(&sample.prefix_tokens) {
        return Err(format!(
            "{} prefix tokens, the policy takes 1 to {}",
            sample.prefix_tokens,
            config.max_prefix_tokens()
        ));
    }
    let layer = sample.prefix_tokens * config.kv_width();
    for (what, layers) in [("keys", &sample.keys), ("values", &sample.values)] {
        if layers.len() != config.text.layers || layers.iter().any(|l| l.len() != layer) {
            return Err(format!(
                "its {what} are not {} layers of {layer} values",
                config.text.layers
            ));
        }
        if layers.iter().flatten().any(|x| !x.is_finite()) {
            return Err(format!("its {what} hold a value that is not finite"));
        }
    }
    if sample.actions.len() != config.chunk_elements() || sample.is_pad.len() != config.chunk_size {
        return Err(format!(
            "{} action values and {} padding flags, the policy takes {} and {}",
            sample.actions.len(),
            sample.is_pad.len(),
            config.chunk_elements(),
            config.chunk_size
        ));
    }
    if sample.actions.iter().any(|x| !x.is_finite()) {
        return Err("its actions hold a value that is not finite".into());
    }
    Ok(())
}
