//! The action expert: from a prefix cache, noisy actions and a time to a velocity.

use candle_core::{DType, Device, Tensor};
use zk0_lerobot::config::{LayerKind, PolicyConfig};
use zk0_lerobot::layout::EXPERT;

use crate::error::Result;
use crate::policy::memory::KeepFreed;
use crate::policy::model::attention::{mix, products, Mask};
use crate::policy::model::kernels::linear::LinearLayer;
use crate::policy::model::kernels::swiglu::silu;
use crate::policy::model::key_values::PrefixCache;
use crate::policy::model::layers::{linear, DecoderLayer, RmsNorm};
use crate::policy::model::observe::{ignore, Observer, Site};
use crate::policy::model::rope::Rope;
use crate::policy::model::time_embedding::time_embedding;
use crate::policy::model::visibility::{action_positions, action_sees};
use crate::policy::model::PolicyParameters;

/// The trainable half of the policy.
pub struct ExpertModel {
    layers: Vec<DecoderLayer>,
    norm: RmsNorm,
    action_in: LinearLayer,
    action_out: LinearLayer,
    time_in: LinearLayer,
    time_out: LinearLayer,
    config: PolicyConfig,
    _memory: KeepFreed,
}

impl ExpertModel {
    /// From the expert's weights; more may be there.
    pub fn new(config: &PolicyConfig, parameters: &PolicyParameters) -> Result<Self> {
        let eps = config.rms_norm_eps;
        Ok(Self {
            layers: (0..config.text.layers)
                .map(|i| DecoderLayer::new(parameters, &format!("{EXPERT}.layers.{i}"), eps))
                .collect::<Result<_>>()?,
            norm: RmsNorm::new(parameters, &format!("{EXPERT}.norm"), eps)?,
            action_in: linear(parameters, "model.action_in_proj")?,
            action_out: linear(parameters, "model.action_out_proj")?,
            time_in: linear(parameters, "model.action_time_mlp_in")?,
            time_out: linear(parameters, "model.action_time_mlp_out")?,
            config: config.clone(),
            _memory: KeepFreed::new(),
        })
    }

    /// The velocity (B, chunk, max_action_dim) at noisy actions `x_t` of that shape and one time a sample.
    pub fn forward(&self, cache: &PrefixCache, x_t: &Tensor, times: &[f32]) -> Result<Tensor> {
        self.forward_observed(cache, x_t, times, &mut ignore)
    }

    /// [`Self::forward`], watched.
    pub fn forward_observed(
        &self,
        cache: &PrefixCache,
        x_t: &Tensor,
        times: &[f32],
        observe: &mut Observer,
    ) -> Result<Tensor> {
        observe(Site::NoisedAction, x_t)?;
        let suffix = self.embed(x_t, times, observe)?;
        let output = self.norm.forward(&self.layers(cache, suffix, observe)?)?;
        observe(Site::FinalNorm, &output)?;
        let velocity = self.action_out.forward(&output)?;
        // The loss does not use the others.
        observe(
            Site::Velocity,
            &velocity.narrow(2, 0, self.config.action_dim)?,
        )?;
        Ok(velocity)
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

    /// Action tokens (B, chunk, expert width): actions joined with time, linear, SiLU, linear.
    fn embed(&self, x_t: &Tensor, times: &[f32], observe: &mut Observer) -> Result<Tensor> {
        let (batch, chunk, _) = x_t.dims3()?;
        let actions = self.action_in.forward(x_t)?;
        observe(Site::ActionIn, &actions)?;
        let time = self.embed_time(times, x_t.device())?;
        let time = time
            .unsqueeze(1)?
            .broadcast_as((batch, chunk, self.config.expert.width))?;
        let joined = Tensor::cat(&[actions, time.contiguous()?], 2)?;
        let mixed = self.time_in.forward(&joined)?;
        observe(Site::TimeMlpIn, &mixed)?;
        let mixed = silu(&mixed)?;
        observe(Site::TimeMlpSilu, &mixed)?;
        let suffix = self.time_out.forward(&mixed)?;
        observe(Site::TimeMlpOut, &suffix)?;
        Ok(suffix)
    }

    /// (B, chunk, expert width).
    fn layers(&self, cache: &PrefixCache, mut x: Tensor, observe: &mut Observer) -> Result<Tensor> {
        let (batch, chunk, _) = x.dims3()?;
        let device = &x.device().clone();
        let head_dim = self.config.text.head_dim;
        let valid = &cache.valid;
        let prefix = valid.first().map_or(0, Vec::len);
        let after_prefix: Vec<_> = valid
            .iter()
            .map(|row| action_positions(row, chunk))
            .collect();
        let joint_rope = Rope::new(&after_prefix, head_dim, device)?;
        let cross_rope = Rope::new(&vec![action_positions(&[], chunk); batch], head_dim, device)?;
        let joint_mask = Mask::new((batch, chunk, prefix + chunk), device, |b, q, k| {
            action_sees(&valid[b], q, k)
        })?;
        let cross_mask = Mask::new((batch, chunk, prefix), device, |b, q, k| {
            action_sees(&valid[b], q, k)
        })?;

        for (i, layer) in self.layers.iter().enumerate() {
            let (keys, values) = (&cache.keys[i], &cache.values[i]);
            let normed = layer.normalised(&x)?;
            observe(Site::InputNorm(i), &normed)?;
            let queries = layer.queries(&normed, head_dim)?;
            observe(Site::Query(i), &queries)?;
            let (rope, mask) = match self.config.layer_kind(i) {
                LayerKind::Joint => (&joint_rope, &joint_mask),
                LayerKind::Cross => (&cross_rope, &cross_mask),
            };
            let queries = rope.apply(&queries)?;
            observe(Site::RotatedQuery(i), &queries)?;
            let (keys, values) = match self.config.layer_kind(i) {
                LayerKind::Joint => {
                    let own_keys = layer.keys(&normed, head_dim)?;
                    observe(Site::Key(i), &own_keys)?;
                    let own_keys = rope.apply(&own_keys)?;
                    observe(Site::RotatedKey(i), &own_keys)?;
                    let own_values = layer.values(&normed, head_dim)?;
                    observe(Site::Value(i), &own_values)?;
                    (
                        Tensor::cat(&[keys, &own_keys], 1)?,
                        Tensor::cat(&[values, &own_values], 1)?,
                    )
                }
                LayerKind::Cross => {
                    // The prefix's keys are rotated before the projection.
                    let keys = layer.keys(&keys.flatten_from(2)?, head_dim)?;
                    observe(Site::Key(i), &keys)?;
                    let values = layer.values(&values.flatten_from(2)?, head_dim)?;
                    observe(Site::Value(i), &values)?;
                    (keys, values)
                }
            };
            let scores = products(&queries, &keys)?;
            observe(Site::Scores(i), &scores)?;
            let attended = mix(&scores, &values, mask)?;
            observe(Site::Attention(i), &attended)?;
            x = layer.finish(&x, &attended, &mut |site, values| observe(site(i), values))?;
        }
        Ok(x)
    }
}
