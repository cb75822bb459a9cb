//! Sources of samples, and batches as tensors.

use std::borrow::Cow;

use candle_core::{Device, Tensor};
use zk0_lerobot::config::PolicyConfig;

use crate::error::{PolicyError, Result};
use crate::frames::making::{Coming, MakesSamples};
use crate::frames::sample::{FromFrame, ObservedSample, PreparedSample};
use crate::policy::model::key_values::PrefixCache;

/// Samples by number: in memory, or from a [cache](crate::frames::prefix_cache).
pub trait SampleSource<S: Clone> {
    /// The number of samples.
    fn len(&self) -> usize;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Sample `index`, which is below [`Self::len`].
    ///
    /// # Errors
    /// The sample cannot be made.
    fn sample(&self, index: usize) -> Result<Cow<'_, S>>;

    /// Frees what making samples needs.
    fn rest(&self) {}

    /// Announces the next samples, `at_once` at a time, for [`ahead`](crate::frames::ahead::ahead).
    fn expect(&self, _coming: Coming, _at_once: usize) {}

    /// The maker of the samples, for other threads; `None` if there is none.
    fn makes(&self) -> Option<&dyn MakesSamples<S>> {
        None
    }
}

/// Samples in memory.
pub struct SamplesInMemory<'a, S>(&'a [S]);

impl<'a, S: FromFrame> SamplesInMemory<'a, S> {
    /// Checks all samples.
    ///
    /// # Errors
    /// [`PolicyError::Sample`]: there is none, one does not fit the policy, or a value is not finite.
    pub fn new(config: &PolicyConfig, samples: &'a [S]) -> Result<Self> {
        let all: Vec<&S> = samples.iter().collect();
        check(config, &all, &[])?;
        Ok(Self(samples))
    }
}

impl<S: Clone> SampleSource<S> for SamplesInMemory<'_, S> {
    fn len(&self) -> usize {
        self.0.len()
    }

    fn sample(&self, index: usize) -> Result<Cow<'_, S>> {
        let found = self.0.get(index).map(Cow::Borrowed);
        found.ok_or_else(|| missing(index, self.0.len()))
    }
}

pub(crate) fn missing(index: usize, len: usize) -> PolicyError {
    PolicyError::Sample(format!("there is no sample {index} among {len}"))
}

/// The samples with these numbers.
///
/// # Errors
/// Those of [`SampleSource::sample`].
pub fn pick<'a, S: Clone>(
    source: &'a dyn SampleSource<S>,
    indices: &[usize],
) -> Result<Vec<Cow<'a, S>>> {
    indices.iter().map(|index| source.sample(*index)).collect()
}

/// Samples as tensors. Shorter prefixes are masked.
pub struct Batch {
    /// The prefix.
    pub cache: PrefixCache,
    /// (B, chunk, max_action_dim).
    pub actions: Tensor,
    /// B rows of chunk.
    pub is_pad: Vec<Vec<bool>>,
}

impl Batch {
    /// Copies samples to a device; `numbers` names them in errors.
    ///
    /// # Errors
    /// [`PolicyError::Sample`]: there is none, one does not fit the policy, or a value is not finite.
    pub fn new(
        config: &PolicyConfig,
        samples: &[&PreparedSample],
        numbers: &[usize],
        device: &Device,
    ) -> Result<Self> {
        check(config, samples, numbers)?;
        let longest = samples.iter().map(|s| s.prefix_tokens).max().unwrap_or(0);
        let width = config.kv_width();
        let layers = |part: fn(&PreparedSample) -> &Vec<Vec<f32>>| -> Result<Vec<Tensor>> {
            (0..config.text.layers)
                .map(|layer| {
                    let rows = samples.iter().map(|sample| &part(sample)[layer][..]);
                    let (heads, dim) = (config.text.kv_heads, config.text.head_dim);
                    let shape = (samples.len(), longest, heads, dim);
                    let all = filled_up(rows, longest * width, samples.len());
                    Ok(Tensor::from_vec(all, shape, device)?)
                })
                .collect()
        };
        let actions = samples.iter().flat_map(|s| s.actions.iter().copied());
        let actions: Vec<f32> = actions.collect();
        let shape = (samples.len(), config.chunk_size, config.max_action_dim);
        Ok(Self {
            cache: PrefixCache {
                keys: layers(|s| &s.keys)?,
                values: layers(|s| &s.values)?,
                valid: samples
                    .iter()
                    .map(|s| (0..longest).map(|k| k < s.prefix_tokens).collect())
                    .collect(),
            },
            actions: Tensor::from_vec(actions, shape, device)?,
            is_pad: samples.iter().map(|s| s.is_pad.clone()).collect(),
        })
    }
}

/// Samples without their state's token, and their states.
pub struct ObservedBatch {
    /// The samples, without the prefix's last token.
    pub observed: Batch,
    /// (B, max_state_dim).
    pub state: Tensor,
}

impl ObservedBatch {
    /// As [`Batch::new`].
    ///
    /// # Errors
    /// Those of [`Batch::new`].
    pub fn new(
        config: &PolicyConfig,
        samples: &[&ObservedSample],
        numbers: &[usize],
        device: &Device,
    ) -> Result<Self> {
        check(config, samples, numbers)?;
        let observed: Vec<&PreparedSample> = samples.iter().map(|s| &s.observed).collect();
        let state = samples.iter().flat_map(|s| s.state.iter().copied());
        let state: Vec<f32> = state.collect();
        Ok(Self {
            observed: Batch::new(config, &observed, numbers, device)?,
            state: Tensor::from_vec(state, (samples.len(), config.max_state_dim), device)?,
        })
    }
}

fn check<S: FromFrame>(config: &PolicyConfig, samples: &[&S], numbers: &[usize]) -> Result<()> {
    if samples.is_empty() {
        return Err(PolicyError::Sample("there are no samples".into()));
    }
    for (place, sample) in samples.iter().enumerate() {
        sample.check(config).map_err(|what| {
            let number = numbers.get(place).unwrap_or(&place);
            PolicyError::Sample(format!("sample {number}: {what}"))
        })?;
    }
    Ok(())
}

fn filled_up<'a>(rows: impl Iterator<Item = &'a [f32]>, length: usize, count: usize) -> Vec<f32> {
    let mut all = Vec::with_capacity(count * length);
    for (i, row) in rows.enumerate() {
        all.extend_from_slice(row);
        all.resize((i + 1) * length, 0.0);
    }
    all
}
