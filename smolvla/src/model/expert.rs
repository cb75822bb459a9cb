//! Phase two: the action expert over a prefix cache, from noisy actions and a time to a velocity.

use candle_core::{DType, Device, Module, Tensor};
use candle_nn::Linear;

use super::attention::{attend, Mask};
use super::layers::{linear, DecoderLayer, RmsNorm};
use super::prefix::PrefixCache;
use super::rope::Rope;
use super::time_embedding::time_embedding;
use super::Parameters;
use crate::config::{LayerKind, PolicyConfig};
use crate::error::{PolicyError, Result};
use crate::layout::EXPERT;

/// The trainable half of the policy.
pub struct ExpertModel {
    layers: Vec<DecoderLayer>,
    norm: RmsNorm,
    action_in: Linear,
    action_out: Linear,
    time_in: Linear,
    time_out: Linear,
    config: PolicyConfig,
}

impl ExpertModel {
    /// From weights of the expert (more may be there).
    pub fn new(config: &PolicyConfig, parameters: &Parameters) -> Result<Self> {
        Ok(Self {
            layers: (0..config.text.layers)
                .map(|i| DecoderLayer::new(parameters, &format!("{EXPERT}.layers.{i}")))
                .collect::<Result<_>>()?,
            norm: RmsNorm::new(parameters, &format!("{EXPERT}.norm"))?,
            action_in: linear(parameters, "model.action_in_proj")?,
            action_out: linear(parameters, "model.action_out_proj")?,
            time_in: linear(parameters, "model.action_time_mlp_in")?,
            time_out: linear(parameters, "model.action_time_mlp_out")?,
            config: config.clone(),
        })
    }

    /// The velocity (B, chunk, max_action_dim) at noisy actions `x_t` of the same shape and one time a sample.
    pub fn forward(&self, cache: &PrefixCache, x_t: &Tensor, times: &[f32]) -> Result<Tensor> {
        let hidden = self.hidden_states(cache, &self.embed(x_t, times)?)?;
        let last = hidden
            .last()
            .ok_or_else(|| PolicyError::Config("a policy without layers".into()))?;
        self.velocity(&self.output(last)?)
    }

    /// The time embedding (B, expert width).
    pub fn embed_time(&self, times: &[f32], device: &Device) -> Result<Tensor> {
        let c = &self.config;
        let rows = times
            .iter()
            .flat_map(|t| time_embedding(*t, c.expert.width, c.min_period, c.max_period));
        let embedded = Tensor::from_iter(rows, device)?.to_dtype(DType::F32)?;
        Ok(embedded.reshape((times.len(), c.expert.width))?)
    }

    /// Action tokens (B, chunk, expert width): actions and time joined, linear, SiLU, linear.
    pub fn embed(&self, x_t: &Tensor, times: &[f32]) -> Result<Tensor> {
        let (batch, chunk, _) = x_t.dims3()?;
        let actions = self.action_in.forward(x_t)?;
        let time = self.embed_time(times, x_t.device())?;
        let time = time
            .unsqueeze(1)?
            .broadcast_as((batch, chunk, self.config.expert.width))?;
        let joined = Tensor::cat(&[actions, time.contiguous()?], 2)?;
        Ok(self
            .time_out
            .forward(&self.time_in.forward(&joined)?.silu()?)?)
    }

    /// Input of every layer, then the output of the last: each (B, chunk, expert width).
    pub fn hidden_states(&self, cache: &PrefixCache, suffix: &Tensor) -> Result<Vec<Tensor>> {
        let (batch, chunk, _) = suffix.dims3()?;
        let device = suffix.device();
        let head_dim = self.config.text.head_dim;
        let valid = &cache.valid;
        let prefix = valid.first().map_or(0, Vec::len);
        let from = |start: usize| (start as i64..(start + chunk) as i64).collect::<Vec<_>>();
        let after_prefix: Vec<_> = valid
            .iter()
            .map(|row| from(row.iter().filter(|v| **v).count()))
            .collect();
        let joint_rope = Rope::new(&after_prefix, head_dim, device)?;
        let cross_rope = Rope::new(&vec![from(0); batch], head_dim, device)?;
        let joint_mask = Mask::new((batch, chunk, prefix + chunk), device, |b, q, k| {
            if k < prefix {
                valid[b][k]
            } else {
                k - prefix <= q
            }
        })?;
        let cross_mask = Mask::new((batch, chunk, prefix), device, |b, _, k| valid[b][k])?;

        let mut x = suffix.clone();
        let mut hidden = vec![x.clone()];
        for (i, layer) in self.layers.iter().enumerate() {
            let (keys, values) = (&cache.keys[i], &cache.values[i]);
            let normed = layer.normalised(&x)?;
            let queries = layer.queries(&normed, head_dim)?;
            let attended = match self.config.layer_kind(i) {
                LayerKind::Joint => {
                    let own_keys = joint_rope.apply(&layer.keys(&normed, head_dim)?)?;
                    let own_values = layer.values(&normed, head_dim)?;
                    let keys = Tensor::cat(&[keys, &own_keys], 1)?;
                    let values = Tensor::cat(&[values, &own_values], 1)?;
                    attend(&joint_rope.apply(&queries)?, &keys, &values, &joint_mask)?
                }
                LayerKind::Cross => {
                    // The prefix's keys are rotated already; the expert's projections come after that.
                    let keys = layer.keys(&keys.flatten_from(2)?, head_dim)?;
                    let values = layer.values(&values.flatten_from(2)?, head_dim)?;
                    attend(&cross_rope.apply(&queries)?, &keys, &values, &cross_mask)?
                }
            };
            x = layer.finish(&x, &attended)?;
            hidden.push(x.clone());
        }
        Ok(hidden)
    }

    /// The final norm.
    pub fn output(&self, hidden: &Tensor) -> Result<Tensor> {
        Ok(self.norm.forward(hidden)?)
    }

    /// The velocity from the normed output.
    pub fn velocity(&self, output: &Tensor) -> Result<Tensor> {
        Ok(self.action_out.forward(output)?)
    }
}
