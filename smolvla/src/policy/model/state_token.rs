//! The state's token, and the language layers that it goes through. Where the state projection is trained, the token is computed
//! again at every step.
//!
//! Of all tokens of the prefix only the state's sees the state, so the keys and values of the others stay what they are. Training
//! the state projection costs one token through the language layers that way, not the whole prefix.

use candle_core::{DType, Tensor};
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::layout::VLM;

use crate::error::Result;
use crate::policy::model::attention::{attend, Mask};
use crate::policy::model::kernels::linear::LinearLayer;
use crate::policy::model::key_values::PrefixCache;
use crate::policy::model::layers::DecoderLayer;
use crate::policy::model::rope::Rope;
use crate::policy::model::PolicyParameters;

/// The state projection and the language layers.
#[derive(Clone)]
pub struct StateToken {
    projection: Projection,
    pub(super) layers: Vec<DecoderLayer>,
    head_dim: usize,
}

/// Weight and bias as they are stored. Where they are variables, a rounded copy would stay what it was when they change: they are
/// rounded at every pass.
#[derive(Clone)]
struct Projection {
    weight: Tensor,
    bias: Tensor,
    operands: DType,
}

impl Projection {
    fn new(parameters: &PolicyParameters) -> Result<Self> {
        Ok(Self {
            weight: parameters.get("model.state_proj.weight")?,
            bias: parameters.get("model.state_proj.bias")?,
            operands: parameters.operands,
        })
    }

    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let (weight, bias) = (
            self.weight.to_dtype(self.operands)?,
            self.bias.to_dtype(self.operands)?,
        );
        Ok(LinearLayer::new(weight, Some(bias)).forward(x)?)
    }
}

impl StateToken {
    /// From the weights that [`Self::needs`] names, and those of the state projection. It multiplies in their
    /// [precision](PolicyParameters::in_precision), which has to be that of the prefixes that are [joined](Self::join).
    pub fn new(config: &PolicyConfig, parameters: &PolicyParameters) -> Result<Self> {
        let (text, eps) = (format!("{VLM}.text_model"), config.rms_norm_eps);
        let layer = |i| DecoderLayer::new(parameters, &format!("{text}.layers.{i}"), eps);
        Ok(Self {
            projection: Projection::new(parameters)?,
            layers: (0..config.text.layers).map(layer).collect::<Result<_>>()?,
            head_dim: config.text.head_dim,
        })
    }

    /// The same language layers, in their precision, after another projection.
    pub fn with_projection(&self, parameters: &PolicyParameters) -> Result<Self> {
        let projection = Projection {
            operands: self.projection.operands,
            ..Projection::new(parameters)?
        };
        Ok(Self {
            projection,
            ..self.clone()
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
            let v = layer.values(&normed, self.head_dim)?;
            let k = Tensor::cat(&[seen_keys, &k], 1)?;
            // Rounding them loses nothing, because they are the result of such a product.
            let seen_values = seen_values.to_dtype(v.dtype())?;
            let v = Tensor::cat(&[&seen_values, &v], 1)?;
            // Nothing reads the last layer's result for its keys and values.
            if i + 1 < self.layers.len() {
                let q = rope.apply(&layer.queries(&normed, self.head_dim)?)?;
                x = layer.finish(&x, &attend(&q, &k, &v, &mask)?, &mut |_, _| Ok(()))?;
            }
            keys.push(k);
            values.push(v.to_dtype(x.dtype())?);
        }
        Ok(PrefixCache {
            keys,
            values,
            valid,
        })
    }
}
