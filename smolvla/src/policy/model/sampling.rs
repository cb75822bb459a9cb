//! Euler steps from noise to actions, as LeRobot 0.4.4's `sample_actions`.

use candle_core::Tensor;

use crate::error::{PolicyError, Result};
use crate::policy::model::expert::ExpertModel;
use crate::policy::model::key_values::PrefixCache;

/// An Euler step, before it is made.
pub struct EulerStep<'a> {
    /// Flow time, from 1 down to `1 / steps`.
    pub time: f32,
    /// The sample (B, chunk, max_action_dim).
    pub x_t: &'a Tensor,
    /// Its velocity (B, chunk, max_action_dim).
    pub v_t: &'a Tensor,
}

/// Normalised actions (B, chunk, max_action_dim) from standard normal `noise` of that shape, in `steps` Euler steps.
///
/// # Errors
/// [`PolicyError::Options`] if `steps` is 0.
pub fn sample_actions(
    expert: &ExpertModel,
    cache: &PrefixCache,
    noise: &Tensor,
    steps: usize,
) -> Result<Tensor> {
    sample_actions_observed(expert, cache, noise, steps, &mut |_| Ok(()))
}

/// [`sample_actions`], with an observer.
pub fn sample_actions_observed(
    expert: &ExpertModel,
    cache: &PrefixCache,
    noise: &Tensor,
    steps: usize,
    observe: &mut dyn FnMut(EulerStep) -> Result<()>,
) -> Result<Tensor> {
    if steps == 0 {
        return Err(PolicyError::Options(
            "sampling takes at least one step".into(),
        ));
    }
    let batch = noise.dim(0)?;
    // In f64 from the step's number: LeRobot 0.3.3's sums in f32 drift.
    let dt = -1.0 / steps as f64;
    let mut x_t = noise.detach();
    for step in 0..steps {
        let time = (1.0 + step as f64 * dt) as f32;
        let v_t = expert.forward(cache, &x_t, &vec![time; batch])?.detach();
        observe(EulerStep {
            time,
            x_t: &x_t,
            v_t: &v_t,
        })?;
        x_t = (x_t + (v_t * dt)?)?;
    }
    Ok(x_t)
}
