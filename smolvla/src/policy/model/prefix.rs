//! Phase one: images, language and state to the per-layer key/value cache that the expert reads.

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
    /// Whether sample `b` really has this camera.
    pub present: Vec<bool>,
}

/// What the prefix is made of, for a batch.
pub struct PrefixInput {
    /// At most as many as the policy has slots.
    pub cameras: Vec<CameraInput>,
    /// Token ids (B, L), `u32`; L may be zero.
    pub tokens: Tensor,
    /// Which of them are real: B rows of L.
    pub token_mask: Vec<Vec<bool>>,
    /// (B, max_state_dim), normalised and zero-padded.
    pub state: Tensor,
}

/// The prefix as the language layers read it: cameras, then language, then one state token, then filling up to the
/// configuration's `prefix_length`.
pub struct PrefixEmbedding {
    /// (B, P, text width).
    pub tokens: Tensor,
    /// Which tokens are real: B rows of P.
    pub valid: Vec<Vec<bool>>,
    /// Which of them is the state token.
    pub state: usize,
}

/// Called after every language layer with its attention's output (B, P, heads * head_dim), before the output projection, and with
/// its own (B, P, text width).
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
    /// From the weights of a whole policy, or of its frozen half. It multiplies in their
    /// [precision](PolicyParameters::in_precision); keys and values are `f32` whichever that is.
    pub fn new(config: &PolicyConfig, parameters: &PolicyParameters) -> Result<Self> {
        Ok(Self {
            vision: Vision::new(config, parameters)?,
            embeddings: parameters.get(&format!("{VLM}.text_model.embed_tokens.weight"))?,
            text: StateToken::new(config, parameters)?,
            config: config.clone(),
            _memory: KeepFreed::new(),
        })
    }

    /// Where it computes.
    pub fn device(&self) -> &Device {
        self.embeddings.device()
    }

    /// The vision tower.
    pub fn vision(&self) -> &Vision {
        &self.vision
    }

    /// The cache of a batch: [`Self::embed`], then the language layers.
    pub fn cache(&self, input: &PrefixInput) -> Result<PrefixCache> {
        self.layers(&self.embed(input)?, None)
    }

    /// Embeds cameras, language and state. Image and language tokens are scaled by sqrt(text width), the
    /// state is not.
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

    /// Runs the language layers. Images and language see each other; the state sees them and itself. The expert reads keys and
    /// values of the last layer and nothing after them, so that the last one is finished only for an observer.
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

    /// [`Self::cache`], through which a gradient reaches `state_proj` and nothing else: only the state's token depends on it, so
    /// that all others are computed without one. Takes one token more than [`Self::cache`], and stores nothing for the others.
    ///
    /// The state's token is the last, and where it was before no token is valid.
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
