//! AdamW: named variables with their moments.

use std::borrow::Cow;
use std::collections::BTreeMap;

use candle_core::backprop::GradStore;
use candle_core::Var;
use zk0_tensors::TensorError;

use crate::error::{PolicyError, Result};
use crate::policy::model::kernels::serve;
use crate::train::optimizer::device::{self, DeviceSlot};
use crate::train::optimizer::factors::{AdamWOptions, Factors, Squares};
use crate::train::optimizer::host::HostSlot;
use crate::train::optimizer::last_step::LastStep;
use crate::train::optimizer::step::{gradient, Optimizer, Stepped};

/// AdamW over named variables.
pub struct AdamW {
    options: AdamWOptions,
    mu: f64,
    slots: BTreeMap<String, (Var, Slot)>,
    last_step: Option<LastStep>,
    steps: u64,
}

enum Slot {
    Host(HostSlot),
    Device(DeviceSlot),
}

impl AdamW {
    /// With zero moments.
    pub fn new(variables: &BTreeMap<String, Var>, options: AdamWOptions) -> Result<Self> {
        Self::proximal(variables, options, 0.0)
    }

    /// As [`Self::new`], but every loss gains `mu / 2 * |w - w0|^2`, where `w0` are the current values: FedProx (Li et al. 2020). Clipping
    /// includes it.
    pub fn proximal(
        variables: &BTreeMap<String, Var>,
        options: AdamWOptions,
        mu: f64,
    ) -> Result<Self> {
        let slots = variables
            .iter()
            .map(|(name, variable)| {
                let anchored = mu > 0.0;
                let slot = if serve(variable) {
                    Slot::Host(HostSlot::new(variable, anchored)?)
                } else {
                    Slot::Device(DeviceSlot::new(variable, anchored)?)
                };
                Ok((name.clone(), (variable.clone(), slot)))
            })
            .collect::<Result<_>>()?;
        Ok(Self {
            options,
            mu,
            slots,
            last_step: None,
            steps: 0,
        })
    }

    /// Follows the last global step in part (FedCM).
    pub fn follow(&mut self, last_step: LastStep) {
        self.last_step = Some(last_step);
    }

    /// Steps made, over all resumptions.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// The moments as `exp_avg.NAME` and `exp_avg_sq.NAME` (torch's words).
    pub fn moments(&self) -> Result<Vec<AdamMoment<'_>>> {
        let mut all = Vec::with_capacity(2 * self.slots.len());
        for (name, (variable, slot)) in &self.slots {
            let [mean, square] = match slot {
                Slot::Host(slot) => slot.moments().map(Cow::Borrowed),
                Slot::Device(slot) => slot.moments()?.map(Cow::Owned),
            };
            for (kind, values) in [(MEAN, mean), (MEAN_SQUARE, square)] {
                all.push(AdamMoment {
                    name: format!("{kind}.{name}"),
                    shape: variable.dims().to_vec(),
                    values,
                });
            }
        }
        Ok(all)
    }

    /// Goes on from an optimiser of the same variables after `steps` steps. `read` gives [`Self::moments`] by name and shape.
    ///
    /// # Errors
    /// Those of `read`, and [`TensorError::Shape`] for a tensor of another size.
    pub fn restore(
        &mut self,
        steps: u64,
        read: &mut dyn FnMut(&str, &[usize]) -> Result<Vec<f32>>,
    ) -> Result<()> {
        for (name, (variable, slot)) in &mut self.slots {
            let shape = variable.dims();
            let mut moment = |kind: &str| {
                let name = format!("{kind}.{name}");
                let values = read(&name, shape)?;
                if values.len() != variable.elem_count() {
                    let wrong = TensorError::Shape {
                        name,
                        expected: shape.to_vec(),
                        found: vec![values.len()],
                    };
                    return Err(PolicyError::from(wrong));
                }
                Ok(values)
            };
            let (mean, square) = (moment(MEAN)?, moment(MEAN_SQUARE)?);
            match slot {
                Slot::Host(slot) => slot.restore(mean, square),
                Slot::Device(slot) => slot.restore(variable, mean, square)?,
            }
        }
        self.steps = steps;
        Ok(())
    }
}

impl Optimizer for AdamW {
    fn step(&mut self, gradients: &GradStore, learning_rate: f64) -> Result<Stepped> {
        let mut sums = Squares::default();
        let mut on_device = Vec::new();
        for (name, (variable, slot)) in &self.slots {
            let gradient = gradient(gradients, name, variable)?;
            match slot {
                Slot::Host(slot) => sums.add(slot.squares(variable, &gradient, self.mu)?),
                Slot::Device(slot) => on_device.push(slot.squares(variable, &gradient, self.mu)?),
            }
        }
        sums.add(device::total(&on_device)?);
        let norm = sums.gradient.sqrt();
        if !norm.is_finite() {
            return Err(PolicyError::GradientNotFinite { norm });
        }

        let o = self.options;
        self.steps = self.steps.saturating_add(1);
        let step = i32::try_from(self.steps).unwrap_or(i32::MAX);
        let own = self.last_step.as_ref().map_or(1.0, LastStep::own);
        let by = Factors {
            options: o,
            mu: self.mu,
            clip: (o.clip_norm / (norm + 1e-6)).min(1.0),
            keep: 1.0 - learning_rate * o.weight_decay,
            rate: own * learning_rate / (1.0 - o.beta1.powi(step)),
            root_bias: (1.0 - o.beta2.powi(step)).sqrt(),
        };
        for (name, (variable, slot)) in &mut self.slots {
            let gradient = gradient(gradients, name, variable)?;
            match slot {
                Slot::Host(slot) => slot.update(variable, &gradient, &by)?,
                Slot::Device(slot) => slot.update(variable, &gradient, &by)?,
            }
            if let Some(last_step) = &self.last_step {
                last_step.add(name, variable, learning_rate)?;
            }
        }
        Ok(Stepped {
            gradient_norm: norm,
            proximal: 0.5 * self.mu * sums.distance,
        })
    }
}

const MEAN: &str = "exp_avg";
const MEAN_SQUARE: &str = "exp_avg_sq";

/// A moment of a variable.
pub struct AdamMoment<'a> {
    /// `exp_avg.NAME` or `exp_avg_sq.NAME`.
    pub name: String,
    /// The variable's.
    pub shape: Vec<usize>,
    /// Row-major.
    pub values: Cow<'a, [f32]>,
}
