//! Flow matching, with both of LeRobot's losses.

use candle_core::Tensor;

use crate::error::Result;

/// `x_t = t * noise + (1 - t) * action` for (B, chunk, dims) and one time a sample.
pub fn noisy_actions(actions: &Tensor, noise: &Tensor, times: &[f32]) -> Result<Tensor> {
    let t = Tensor::from_slice(times, (times.len(), 1, 1), actions.device())?;
    Ok((noise.broadcast_mul(&t)? + actions.broadcast_mul(&t.affine(-1.0, 1.0)?)?)?)
}

/// The velocity to learn, `noise - action`.
pub fn target_velocity(actions: &Tensor, noise: &Tensor) -> Result<Tensor> {
    Ok((noise - actions)?)
}

/// Squared errors, elementwise.
pub fn losses(velocity: &Tensor, target: &Tensor) -> Result<Tensor> {
    Ok((target - velocity)?.sqr()?)
}

/// LeRobot 0.4's mean, with padded frames and dimensions.
pub fn mean_loss(losses: &Tensor) -> Result<Tensor> {
    Ok(losses.mean_all()?)
}

/// LeRobot 0.6's and a claim's mean: real action dimensions of frames that are not padding, or 0. `is_pad`: a row of `chunk` per sample.
pub fn mean_loss_valid_only(
    losses: &Tensor,
    action_dim: usize,
    is_pad: &[Vec<bool>],
) -> Result<Tensor> {
    let (batch, chunk, _) = losses.dims3()?;
    let weights: Vec<f32> = is_pad
        .iter()
        .flatten()
        .map(|pad| if *pad { 0.0 } else { 1.0 })
        .collect();
    let count = weights.iter().filter(|w| **w > 0.0).count() * action_dim;
    let weights = Tensor::from_vec(weights, (batch, chunk, 1), losses.device())?;
    let total = losses
        .narrow(2, 0, action_dim)?
        .broadcast_mul(&weights)?
        .sum_all()?;
    Ok((total / count.max(1) as f64)?)
}
