//! Images, language and state to the expert's key/value cache.

use candle_core::{Device, Tensor};
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::layout::VLM;

use crate::error::{PolicyError, Result};
use crate::policy::memory::KeepFreed;
use crate::policy::model::attention::{attend, Mask};
use crate::policy::model::key_values::PrefixCache;
use crate::policy::model::rope::Rope;
use crate::policy::model::state_token::StateToken;
use crate::policy::model::visibility::{prefix_positions, prefix_sees};
use crate::policy::model::vision::Vision;
use crate::policy::model::PolicyParameters;

/// One camera of a batch.
pub struct CameraInput {
    /// (B, 3, size, size), values in [-1, 1].
    pub pixels: Tensor,
    /// Whether sample `b` has this camera.
    pub present: Vec<bool>,
}

/// A batch's inputs.
pub struct PrefixInput {
    /// At most one per slot of the policy.
    pub cameras: Vec<CameraInput>,
    /// Token ids (B, L), `u32`; L may be zero.
    pub tokens: Tensor,
    /// Which are real: B rows of L.
    pub token_mask: Vec<Vec<bool>>,
    /// (B, max_state_dim), normalised and zero-padded.
    pub state: Tensor,
}

/// The language layers' input: cameras, language, one state token, padding to `prefix_length`.
pub struct PrefixEmbedding {
    /// (B, P, text width).
    pub tokens: Tensor,
    /// Which are real: B rows of P.
    pub valid: Vec<Vec<bool>>,
    /// The state token's index.
    pub state: usize,
}

/// Gets each layer's attention output (B, P, heads * head_dim), before the output projection, and result (B, P, text width).
type LayerObserver<'a> = &'a mut dyn FnMut(&Tensor, &Tensor);

/// The frozen half of the policy.
pub struct PrefixModel {
    vision: Vision,
    embeddings: Tensor,
    text: StateToken,
    config: PolicyConfig,
    _memory: KeepFreed,
}

impl PrefixModel {
    /// From the weights of a policy or its frozen half, in their [precision](PolicyParameters::in_precision); keys and values are always
    /// `f32`.
    pub fn new(config: &PolicyConfig, parameters: &PolicyParameters) -> Result<Self> {
        Ok(Self {
            vision: Vision::new(config, parameters)?,
            embeddings: parameters.get(&format!("{VLM}.text_model.embed_tokens.weight"))?,
            text: StateToken::new(config, parameters)?,
            config: config.clone(),
            _memory: KeepFreed::new(),
        })
    }

    /// The device that computes.
    pub fn device(&self) -> &Device {
        self.embeddings.device()
    }

    /// The vision tower.
    pub fn vision(&self) -> &Vision {
        &self.vision
    }

    /// A batch's cache: [`Self::embed`], then the language layers.
    pub fn cache(&self, input: &PrefixInput) -> Result<PrefixCache> {
        self.layers(&self.embed(input)?, None)
    }

    /// Embeds cameras, language and state. Images and language are scaled by sqrt(text width).
    pub fn embed(&self, input: &PrefixInput) -> Result<PrefixEmbedding> {
        let (batch, language) = input.tokens.dims2()?;
        if input.cameras.len() > self.config.cameras {
            return Err(PolicyError::Sample(format!(
                "{} cameras for a policy with {} slots",
                input.cameras.len(),
                self.config.cameras
            )));
        }
        let scale = (self.config.text.width as f64).sqrt();
        let mut parts = Vec::new();
        let mut valid = vec![Vec::new(); batch];
        for camera in &input.cameras {
            let tokens = (self.vision.tokens(&camera.pixels, &mut |_, _| ())? * scale)?;
            let count = tokens.dim(1)?;
            for (row, present) in valid.iter_mut().zip(&camera.present) {
                row.extend(std::iter::repeat_n(*present, count));
            }
            parts.push(tokens);
        }
        if language > 0 {
            let words = self
                .embeddings
                .index_select(&input.tokens.flatten_all()?, 0)?;
            parts.push((words.reshape((batch, language, self.config.text.width))? * scale)?);
        }
        parts.push(self.text.token(&input.state)?);
        for (row, mask) in valid.iter_mut().zip(&input.token_mask) {
            row.extend(mask);
            row.push(true);
        }
        let tokens = Tensor::cat(&parts, 1)?;
        let count = tokens.dim(1)?;
        if tokens.dim(0)? != batch || valid.iter().any(|row| row.len() != count) {
            return Err(PolicyError::Sample(
                "camera or token masks do not fit the batch".into(),
            ));
        }
        let length = self.config.prefix_length.max(count);
        valid.iter_mut().for_each(|row| row.resize(length, false));
        Ok(PrefixEmbedding {
            tokens: tokens.pad_with_zeros(1, 0, length - count)?,
            valid,
            state: count - 1,
        })
    }

    /// Runs the language layers. The expert reads only the last layer's keys and values: only observers need its result.
    pub fn layers(
        &self,
        embedding: &PrefixEmbedding,
        mut observe: Option<LayerObserver>,
    ) -> Result<PrefixCache> {
        let (batch, count, _) = embedding.tokens.dims3()?;
        let device = embedding.tokens.device();
        let head_dim = self.config.text.head_dim;
        let valid = &embedding.valid;
        let mask = Mask::new((batch, count, count), device, |b, q, k| {
            prefix_sees(&valid[b], embedding.state, q, k)
        })?;
        let positions: Vec<Vec<i64>> = valid.iter().map(|row| prefix_positions(row)).collect();
        let rope = Rope::new(&positions, head_dim, device)?;

        let mut x = embedding.tokens.clone();
        let (mut keys, mut values) = (Vec::new(), Vec::new());
        for (i, layer) in self.text.layers.iter().enumerate() {
            let normed = layer.normalised(&x)?;
            let k = rope.apply(&layer.keys(&normed, head_dim)?)?;
            let v = layer.values(&normed, head_dim)?;
            if i + 1 < self.text.layers.len() || observe.is_some() {
                let q = rope.apply(&layer.queries(&normed, head_dim)?)?;
                let mixed = attend(&q, &k, &v, &mask)?;
                x = layer.finish(&x, &mixed, &mut |_, _| Ok(()))?;
                if let Some(observe) = &mut observe {
                    observe(&mixed, &x);
                }
            }
            keys.push(k);
            values.push(v.to_dtype(x.dtype())?);
        }
        Ok(PrefixCache {
            keys,
            values,
            valid: valid.clone(),
        })
    }

    /// [`Self::cache`] with a gradient for `state_proj` only, for one token more: no other token depends on it. The state's token is the
    /// last; its old place is not valid.
    pub fn cache_training_state(&self, input: &PrefixInput) -> Result<PrefixCache> {
        let mut embedding = self.embed(input)?;
        embedding.tokens = embedding.tokens.detach();
        let mut observed = self.layers(&embedding, None)?;
        for row in &mut observed.valid {
            row[embedding.state] = false;
        }
        self.text.join(&observed, &input.state)
    }
}
