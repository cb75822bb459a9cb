//! The vision tower (SigLIP) and the connector from patches to language-model tokens. Both are frozen: no backward pass.

use candle_core::Tensor;
use zk0_lerobot::config::{PolicyConfig, CHANNELS, LAYER_NORM_EPS};
use zk0_lerobot::layout::VLM;

use crate::error::Result;
use crate::policy::model::kernels::attention::attend_to_all;
use crate::policy::model::kernels::gelu::gelu_tanh;
use crate::policy::model::kernels::linear::LinearLayer;
use crate::policy::model::kernels::norm::layer_norm;
use crate::policy::model::layers::{linear, linear_no_bias};
use crate::policy::model::PolicyParameters;

/// Vision tower and connector.
pub struct Vision {
    patch: LinearLayer,
    positions: Tensor,
    layers: Vec<EncoderLayer>,
    post_norm: LayerNorm,
    connector: LinearLayer,
    patch_size: usize,
    shuffle: usize,
}

/// A value in the pass over a camera's images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VisionSite {
    /// The patch convolution (B, patches, width), without positions.
    Patches,
    /// An encoder layer's input, or the last one's output: (B, patches, width).
    Hidden(usize),
    /// After the final norm (B, patches, width).
    Normed,
}

struct EncoderLayer {
    norm1: LayerNorm,
    qkv: LinearLayer,
    out: LinearLayer,
    norm2: LayerNorm,
    fc1: LinearLayer,
    fc2: LinearLayer,
    heads: usize,
}

impl Vision {
    /// From a whole policy's weights.
    pub fn new(config: &PolicyConfig, parameters: &PolicyParameters) -> Result<Self> {
        let tower = format!("{VLM}.vision_model");
        let vision = &config.vision;
        let patch_weight =
            parameters.operand(&format!("{tower}.embeddings.patch_embedding.weight"))?;
        let patch_weight = patch_weight.reshape((
            vision.width,
            CHANNELS * vision.patch_size * vision.patch_size,
        ))?;
        let patch_bias = parameters.operand(&format!("{tower}.embeddings.patch_embedding.bias"))?;
        Ok(Self {
            patch: LinearLayer::new(patch_weight, Some(patch_bias)),
            positions: parameters.get(&format!("{tower}.embeddings.position_embedding.weight"))?,
            layers: (0..vision.layers)
                .map(|i| {
                    EncoderLayer::new(
                        parameters,
                        &format!("{tower}.encoder.layers.{i}"),
                        vision.heads,
                    )
                })
                .collect::<Result<_>>()?,
            post_norm: LayerNorm::new(parameters, &format!("{tower}.post_layernorm"))?,
            connector: linear_no_bias(
                parameters,
                &format!("{VLM}.connector.modality_projection.proj"),
            )?,
            patch_size: vision.patch_size,
            shuffle: vision.shuffle,
        })
    }

    /// Unscaled tokens (B, tokens_per_camera, text width) of images (B, 3, size, size) in [-1, 1]. `observe` gets the values.
    pub fn tokens(
        &self,
        images: &Tensor,
        observe: &mut dyn FnMut(VisionSite, &Tensor),
    ) -> Result<Tensor> {
        let patches = self.patch.forward(&self.patches(images)?)?;
        observe(VisionSite::Patches, &patches);
        let patches = patches.to_dtype(self.positions.dtype())?;
        let mut x = patches.broadcast_add(&self.positions)?;
        for (i, layer) in self.layers.iter().enumerate() {
            observe(VisionSite::Hidden(i), &x);
            x = layer.forward(&x)?;
        }
        observe(VisionSite::Hidden(self.layers.len()), &x);
        let normed = self.post_norm.forward(&x)?;
        observe(VisionSite::Normed, &normed);
        let tokens = self.connector.forward(&self.pixel_shuffle(&normed)?)?;
        Ok(tokens.to_dtype(normed.dtype())?)
    }

    /// (B, 3, size, size) to (B, patches, 3 * patch * patch): the patch convolution as a matrix product, without incomplete patches.
    fn patches(&self, images: &Tensor) -> Result<Tensor> {
        let (batch, channels, height, width) = images.dims4()?;
        let p = self.patch_size;
        let (rows, columns) = (height / p, width / p);
        let split = images
            .narrow(2, 0, rows * p)?
            .narrow(3, 0, columns * p)?
            .reshape((batch, channels, rows, p, columns, p))?
            .permute((0, 2, 4, 1, 3, 5))?;
        Ok(split.reshape((batch, rows * columns, channels * p * p))?)
    }

    /// Joins `shuffle x shuffle` patches into a token, features in (row, column, width) order.
    fn pixel_shuffle(&self, x: &Tensor) -> Result<Tensor> {
        let (batch, patches, width) = x.dims3()?;
        let (s, side) = (self.shuffle, patches.isqrt() / self.shuffle);
        let split = x
            .reshape((batch, side, s, side, s, width))?
            .permute((0, 1, 3, 2, 4, 5))?;
        Ok(split.reshape((batch, side * side, s * s * width))?)
    }
}

impl EncoderLayer {
    fn new(parameters: &PolicyParameters, name: &str, heads: usize) -> Result<Self> {
        let joined = |part: &str| -> Result<Tensor> {
            let get = |which| parameters.operand(&format!("{name}.self_attn.{which}_proj.{part}"));
            Ok(Tensor::cat(&[get("q")?, get("k")?, get("v")?], 0)?)
        };
        Ok(Self {
            norm1: LayerNorm::new(parameters, &format!("{name}.layer_norm1"))?,
            qkv: LinearLayer::new(joined("weight")?, Some(joined("bias")?)),
            out: linear(parameters, &format!("{name}.self_attn.out_proj"))?,
            norm2: LayerNorm::new(parameters, &format!("{name}.layer_norm2"))?,
            fc1: linear(parameters, &format!("{name}.mlp.fc1"))?,
            fc2: linear(parameters, &format!("{name}.mlp.fc2"))?,
            heads,
        })
    }

    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let normed = self.norm1.forward(x)?;
        let attended = attend_to_all(&self.qkv.forward(&normed)?, self.heads)?;
        let x = self.out.forward_onto(x, &attended)?;
        let mlp = gelu_tanh(self.fc1.forward(&self.norm2.forward(&x)?)?)?;
        Ok(self.fc2.forward_onto(&x, &mlp)?)
    }
}

struct LayerNorm {
    gain: Tensor,
    bias: Tensor,
}

impl LayerNorm {
    fn new(parameters: &PolicyParameters, name: &str) -> Result<Self> {
        Ok(Self {
            gain: parameters.get(&format!("{name}.weight"))?,
            bias: parameters.get(&format!("{name}.bias"))?,
        })
    }

    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        Ok(layer_norm(x, &self.gain, &self.bias, LAYER_NORM_EPS)?)
    }
}
