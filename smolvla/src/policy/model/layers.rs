//! Linear maps, RMSNorm, the SwiGLU MLP, and a Llama layer.

use candle_core::Tensor;

use crate::error::Result;
use crate::policy::model::kernels::linear::LinearLayer;
use crate::policy::model::kernels::norm::rms_norm;
use crate::policy::model::kernels::swiglu::swiglu;
use crate::policy::model::observe::Site;
use crate::policy::model::PolicyParameters;

/// `name.weight` without a bias.
pub fn linear_no_bias(parameters: &PolicyParameters, name: &str) -> Result<LinearLayer> {
    Ok(LinearLayer::new(
        parameters.operand(&format!("{name}.weight"))?,
        None,
    ))
}

/// `name.weight` and `name.bias`.
pub fn linear(parameters: &PolicyParameters, name: &str) -> Result<LinearLayer> {
    let weight = parameters.operand(&format!("{name}.weight"))?;
    Ok(LinearLayer::new(
        weight,
        Some(parameters.operand(&format!("{name}.bias"))?),
    ))
}

/// Root-mean-square norm over the last dimension, with a gain.
#[derive(Clone)]
pub struct RmsNorm {
    gain: Tensor,
    eps: f64,
}

impl RmsNorm {
    /// The norm with gain `name.weight`.
    pub fn new(parameters: &PolicyParameters, name: &str, eps: f64) -> Result<Self> {
        let gain = parameters.get(&format!("{name}.weight"))?;
        Ok(Self { gain, eps })
    }

    /// `x / sqrt(mean(x^2) + eps) * gain`.
    pub fn forward(&self, x: &Tensor) -> candle_core::Result<Tensor> {
        rms_norm(x, &self.gain, self.eps)
    }
}

/// A Llama layer without its attention.
#[derive(Clone)]
pub struct DecoderLayer {
    input_norm: RmsNorm,
    q: LinearLayer,
    k: LinearLayer,
    v: LinearLayer,
    o: LinearLayer,
    post_norm: RmsNorm,
    gate: LinearLayer,
    up: LinearLayer,
    down: LinearLayer,
}

impl DecoderLayer {
    /// From the tensors that begin with `name`; `eps` is the norms'.
    pub fn new(parameters: &PolicyParameters, name: &str, eps: f64) -> Result<Self> {
        let matrix = |part: &str| linear_no_bias(parameters, &format!("{name}.{part}"));
        let norm = |part: &str| RmsNorm::new(parameters, &format!("{name}.{part}"), eps);
        Ok(Self {
            input_norm: norm("input_layernorm")?,
            q: matrix("self_attn.q_proj")?,
            k: matrix("self_attn.k_proj")?,
            v: matrix("self_attn.v_proj")?,
            o: matrix("self_attn.o_proj")?,
            post_norm: norm("post_attention_layernorm")?,
            gate: matrix("mlp.gate_proj")?,
            up: matrix("mlp.up_proj")?,
            down: matrix("mlp.down_proj")?,
        })
    }

    /// The first norm.
    pub fn normalised(&self, hidden: &Tensor) -> Result<Tensor> {
        Ok(self.input_norm.forward(hidden)?)
    }

    /// Queries (B, L, heads, head_dim), not yet rotated.
    pub fn queries(&self, x: &Tensor, head_dim: usize) -> Result<Tensor> {
        heads(&self.q.forward(x)?, head_dim)
    }

    /// Keys (B, L, kv_heads, head_dim), not yet rotated.
    pub fn keys(&self, x: &Tensor, head_dim: usize) -> Result<Tensor> {
        heads(&self.k.forward(x)?, head_dim)
    }

    /// Values (B, L, kv_heads, head_dim).
    pub fn values(&self, x: &Tensor, head_dim: usize) -> Result<Tensor> {
        heads(&self.v.forward(x)?, head_dim)
    }

    /// All after the attention: output projection, residual, second norm, SwiGLU MLP, residual. `observe` gets every value, with its
    /// [`Site`] as a function of the layer's number.
    pub fn finish(
        &self,
        hidden: &Tensor,
        attended: &Tensor,
        observe: &mut dyn FnMut(fn(usize) -> Site, &Tensor) -> Result<()>,
    ) -> Result<Tensor> {
        let out = self.o.forward(attended)?.to_dtype(hidden.dtype())?;
        observe(Site::AttentionOut, &out)?;
        let hidden = (out + hidden)?;
        observe(Site::Attended, &hidden)?;
        let x = self.post_norm.forward(&hidden)?;
        observe(Site::MlpNorm, &x)?;
        let (gate, up) = (self.gate.forward(&x)?, self.up.forward(&x)?);
        observe(Site::Gate, &gate)?;
        observe(Site::Up, &up)?;
        let mlp = swiglu(&gate, &up)?;
        observe(Site::Gated, &mlp)?;
        let down = self.down.forward(&mlp)?.to_dtype(hidden.dtype())?;
        observe(Site::Down, &down)?;
        let hidden = (down + hidden)?;
        observe(Site::MlpOut, &hidden)?;
        Ok(hidden)
    }
}

fn heads(x: &Tensor, head_dim: usize) -> Result<Tensor> {
    let (batch, tokens, width) = x.dims3()?;
    Ok(x.reshape((batch, tokens, width / head_dim, head_dim))?)
}
