//! The state's token and the language layers, for training the state projection. Only the state's token sees the state: each step takes one
//! token through the language layers.

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

/// Rounded at every pass: a rounded copy would not follow variables.
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
    /// From the weights that [`Self::needs`] names and the state projection's, in the [precision](PolicyParameters::in_precision) of
    /// [joined](Self::join) prefixes.
    pub fn new(config: &PolicyConfig, parameters: &PolicyParameters) -> Result<Self> {
        let (text, eps) = (format!("{VLM}.text_model"), config.rms_norm_eps);
        let layer = |i| DecoderLayer::new(parameters, &format!("{text}.layers.{i}"), eps);
        Ok(Self {
            projection: Projection::new(parameters)?,
            layers: (0..config.text.layers).map(layer).collect::<Result<_>>()?,
            head_dim: config.text.head_dim,
        })
    }

    /// The same language layers with another projection.
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

    /// Whether this frozen tensor is used.
    pub fn needs(name: &str) -> bool {
        name.starts_with(&format!("{VLM}.text_model.layers."))
    }

    /// The token (B, 1, text width) of states (B, max_state_dim).
    pub(super) fn token(&self, state: &Tensor) -> Result<Tensor> {
        let token = self.projection.forward(state)?.to_dtype(state.dtype())?;
        Ok(token.unsqueeze(1)?)
    }

    /// Completes a prefix with its last token, from states (B, max_state_dim), normalised and zero-padded. `observed` must not have a valid
    /// state token.
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
            // From such a product: rounding loses nothing.
            let seen_values = seen_values.to_dtype(v.dtype())?;
            let v = Tensor::cat(&[&seen_values, &v], 1)?;
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
