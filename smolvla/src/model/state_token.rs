//! The state's token, made anew at every step where the state projection is trained; and the language layers it goes through.
//!
//! Of all tokens of the prefix only the state's sees the state, so the keys and values of the others stay what they are. Training
//! the state projection costs one token through the language layers that way, not the whole prefix.

use candle_core::Tensor;

use super::attention::{attend, Mask};
use super::kernels::linear::Linear;
use super::layers::{linear, DecoderLayer};
use super::prefix::PrefixCache;
use super::rope::Rope;
use super::Parameters;
use crate::config::PolicyConfig;
use crate::error::Result;
use crate::layout::VLM;

/// The state projection and the language layers.
pub struct StateToken {
    projection: Linear,
    pub(super) layers: Vec<DecoderLayer>,
    head_dim: usize,
}

impl StateToken {
    /// From the weights that [`Self::needs`] names, and those of the state projection.
    pub fn new(config: &PolicyConfig, parameters: &Parameters) -> Result<Self> {
        let layer = |i| DecoderLayer::new(parameters, &format!("{VLM}.text_model.layers.{i}"));
        Ok(Self {
            projection: linear(parameters, "model.state_proj")?,
            layers: (0..config.text.layers).map(layer).collect::<Result<_>>()?,
            head_dim: config.text.head_dim,
        })
    }

    /// Whether this frozen tensor plays a part.
    pub fn needs(name: &str) -> bool {
        name.starts_with(&format!("{VLM}.text_model.layers."))
    }

    /// The token (B, 1, text width) of states (B, max_state_dim).
    pub(super) fn token(&self, state: &Tensor) -> Result<Tensor> {
        let token = self.projection.forward(state)?.to_dtype(state.dtype())?;
        Ok(token.unsqueeze(1)?)
    }

    /// Completes a prefix by its last token, from states (B, max_state_dim), normalised and zero-padded. None of `observed`'s
    /// valid tokens may be a state's.
    pub fn join(&self, observed: &PrefixCache, state: &Tensor) -> Result<PrefixCache> {
        let device = state.device();
        let position = |row: &Vec<bool>| vec![row.iter().filter(|valid| **valid).count() as i64];
        let positions: Vec<_> = observed.valid.iter().map(position).collect();
        let rope = Rope::new(&positions, self.head_dim, device)?;
        let mut valid = observed.valid.clone();
        valid.iter_mut().for_each(|row| row.push(true));
        let count = valid.first().map_or(0, Vec::len);
        let mask = Mask::new((valid.len(), 1, count), device, |b, _, k| valid[b][k])?;

        let mut x = self.token(state)?;
        let (mut keys, mut values) = (Vec::new(), Vec::new());
        let seen = observed.keys.iter().zip(&observed.values);
        for (i, (layer, (seen_keys, seen_values))) in self.layers.iter().zip(seen).enumerate() {
            let normed = layer.normalised(&x)?;
            let k = rope.apply(&layer.keys(&normed, self.head_dim)?)?;
            let v = layer.values(&normed, self.head_dim)?.to_dtype(x.dtype())?;
            let k = Tensor::cat(&[seen_keys, &k], 1)?;
            let v = Tensor::cat(&[seen_values, &v], 1)?;
            // Nothing reads what the last layer makes of its keys and values.
            if i + 1 < self.layers.len() {
                let q = rope.apply(&layer.queries(&normed, self.head_dim)?)?;
                x = layer.finish(&x, &attend(&q, &k, &v, &mask)?, &mut |_, _| Ok(()))?;
            }
            keys.push(k);
            values.push(v);
        }
        Ok(PrefixCache {
            keys,
            values,
            valid,
        })
    }
}
