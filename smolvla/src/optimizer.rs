//! AdamW with gradient clipping and the learning-rate schedule of LeRobot's SmolVLA preset.
//!
//! Steps agree with `torch.optim.AdamW` and `torch.nn.utils.clip_grad_norm_`.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use candle_core::backprop::GradStore;
use candle_core::{Tensor, Var};

use crate::error::{PolicyError, Result};

/// Settings besides the learning rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamWOptions {
    /// Decay of the mean gradient.
    pub beta1: f64,
    /// Decay of the mean squared gradient.
    pub beta2: f64,
    /// Added to the root of the mean squared gradient.
    pub eps: f64,
    /// Decoupled weight decay.
    pub weight_decay: f64,
    /// Gradients are scaled down to this L2 norm, over all tensors together.
    pub clip_norm: f64,
}

impl Default for AdamWOptions {
    /// LeRobot's preset for SmolVLA.
    fn default() -> Self {
        Self {
            beta1: 0.9,
            beta2: 0.95,
            eps: 1e-8,
            weight_decay: 1e-10,
            clip_norm: 10.0,
        }
    }
}

/// AdamW over named variables.
pub struct AdamW {
    options: AdamWOptions,
    slots: BTreeMap<String, Slot>,
    steps: i32,
}

struct Slot {
    variable: Var,
    mean: Tensor,
    mean_square: Tensor,
}

impl AdamW {
    /// Starts with zero moments.
    pub fn new(variables: &BTreeMap<String, Var>, options: AdamWOptions) -> Result<Self> {
        let slots = variables
            .iter()
            .map(|(name, variable)| {
                let zeros = variable.zeros_like()?;
                let slot = Slot {
                    variable: variable.clone(),
                    mean: zeros.clone(),
                    mean_square: zeros,
                };
                Ok((name.clone(), slot))
            })
            .collect::<Result<_>>()?;
        Ok(Self {
            options,
            slots,
            steps: 0,
        })
    }

    /// One step; returns the gradient norm before clipping.
    ///
    /// # Errors
    /// [`PolicyError::NoGradient`] when a variable has none: some operation between it and the loss has no backward pass.
    pub fn step(&mut self, gradients: &GradStore, learning_rate: f64) -> Result<f64> {
        let o = self.options;
        let mut square_norm = 0.0;
        for (name, slot) in &self.slots {
            let gradient = gradient(gradients, name, &slot.variable)?;
            square_norm += f64::from(gradient.sqr()?.sum_all()?.to_scalar::<f32>()?);
        }
        let norm = square_norm.sqrt();
        let clip = (o.clip_norm / (norm + 1e-6)).min(1.0);

        self.steps = self.steps.saturating_add(1);
        let correction1 = 1.0 - o.beta1.powi(self.steps);
        let correction2 = (1.0 - o.beta2.powi(self.steps)).sqrt();
        for (name, slot) in &mut self.slots {
            // Without detaching, the moments would keep every step's graph alive.
            let mut g = gradient(gradients, name, &slot.variable)?.detach();
            if clip < 1.0 {
                g = (g * clip)?;
            }
            slot.mean = ((&slot.mean * o.beta1)? + (&g * (1.0 - o.beta1))?)?;
            slot.mean_square = ((&slot.mean_square * o.beta2)? + (g.sqr()? * (1.0 - o.beta2))?)?;
            let root = ((slot.mean_square.sqrt()? / correction2)? + o.eps)?;
            let update = ((&slot.mean / root)? * (learning_rate / correction1))?;
            let kept =
                (slot.variable.as_detached_tensor() * (1.0 - learning_rate * o.weight_decay))?;
            slot.variable.set(&(kept - update)?)?;
        }
        Ok(norm)
    }
}

fn gradient<'a>(gradients: &'a GradStore, name: &str, variable: &Var) -> Result<&'a Tensor> {
    gradients
        .get(variable.as_tensor())
        .ok_or_else(|| PolicyError::NoGradient(name.into()))
}

/// The learning rate over a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Schedule {
    /// The same at every step.
    Constant,
    /// LeRobot's `cosine_decay_with_warmup` preset: linear over 1000 steps, then a cosine down to 1/40 of the peak at step
    /// 30,000; both lengths shrink in proportion for a shorter run.
    WarmupCosine,
}

impl Schedule {
    /// The learning rate of `step` (from 0) in a run of `steps`, for a peak of `peak`.
    pub fn learning_rate(self, peak: f64, step: usize, steps: usize) -> f64 {
        const WARMUP: usize = 1000;
        const DECAY: usize = 30_000;
        const FLOOR: f64 = 0.025;
        match self {
            Self::Constant => peak,
            Self::WarmupCosine => {
                let decay = DECAY.min(steps.max(1));
                let warmup = (WARMUP as f64 * (decay as f64 / DECAY as f64)) as usize;
                if step < warmup {
                    let first = 1.0 / (warmup as f64 + 1.0);
                    return peak * ((first - 1.0) * (1.0 - step as f64 / warmup as f64) + 1.0);
                }
                let progress = step.min(decay) as f64 / decay as f64;
                peak * ((1.0 - FLOOR) * 0.5 * (1.0 + (PI * progress).cos()) + FLOOR)
            }
        }
    }
}
