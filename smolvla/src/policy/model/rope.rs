//! Rotary position embedding over halves (not interleaved pairs), as LeRobot's `apply_rope`.

use candle_core::{Device, Tensor};
use zk0_lerobot::config::ROPE_BASE;

use crate::error::Result;
use crate::policy::model::kernels::rotate::rotate;

/// Sines and cosines for a batch's positions.
pub struct Rope {
    sin: Tensor,
    cos: Tensor,
}

impl Rope {
    /// For token `j` of sample `b` at `positions[b][j]`, in `f32` as in the reference.
    pub fn new(positions: &[Vec<i64>], head_dim: usize, device: &Device) -> Result<Self> {
        let half = head_dim / 2;
        let timescales: Vec<f32> = (0..half)
            .map(|k| ROPE_BASE.powf(2.0 / head_dim as f32 * k as f32))
            .collect();
        let radians: Vec<f32> = positions
            .iter()
            .flatten()
            .flat_map(|position| timescales.iter().map(move |scale| *position as f32 / scale))
            .collect();
        let shape = (
            positions.len(),
            positions.first().map_or(0, Vec::len),
            1,
            half,
        );
        let radians = Tensor::from_vec(radians, shape, device)?;
        Ok(Self {
            sin: radians.sin()?,
            cos: radians.cos()?,
        })
    }

    /// Rotates (B, L, heads, head_dim).
    pub fn apply(&self, x: &Tensor) -> Result<Tensor> {
        Ok(rotate(x, &self.sin, &self.cos)?)
    }
}
