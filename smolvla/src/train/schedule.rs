//! The learning rate over a run.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use crate::error::{PolicyError, Result};

/// The learning rate's course. Lengths are in steps, floors are shares of the peak.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Schedule {
    /// The same at every step.
    Constant,
    /// LeRobot's `cosine_decay_with_warmup`: linear over `warmup` steps from `peak / (warmup + 1)`, then a cosine, counted from step 0, to
    /// `floor` at `decay`, then constant. A run shorter than `decay` shrinks both lengths.
    WarmupCosine {
        /// The peak's step.
        warmup: usize,
        /// The floor's step.
        decay: usize,
        /// The lowest share.
        floor: f64,
    },
    /// Cosines from the peak to `floor`, each `factor` times the last one's length: SGDR (Loshchilov & Hutter 2017), as torch's
    /// `CosineAnnealingWarmRestarts`.
    CosineWarmRestarts {
        /// The first cosine's length.
        first_period: usize,
        /// The length's growth.
        factor: usize,
        /// The lowest share.
        floor: f64,
    },
}

impl Schedule {
    /// LeRobot's preset for SmolVLA: the peak after 1000 steps, 1/40 at step 30,000.
    pub const LEROBOT: Self = Self::WarmupCosine {
        warmup: 1000,
        decay: 30_000,
        floor: 0.025,
    };

    /// The learning rate of `step` (from 0) of `steps`.
    pub fn learning_rate(self, peak: f64, step: usize, steps: usize) -> f64 {
        match self {
            Self::Constant => peak,
            Self::WarmupCosine {
                warmup,
                decay,
                floor,
            } => {
                let shortened = decay.min(steps.max(1));
                let warmup = (warmup as f64 * (shortened as f64 / decay as f64)) as usize;
                if step < warmup {
                    let first = 1.0 / (warmup as f64 + 1.0);
                    return peak * ((first - 1.0) * (1.0 - step as f64 / warmup as f64) + 1.0);
                }
                let progress = step.min(shortened) as f64 / shortened as f64;
                peak * cosine(progress, floor)
            }
            Self::CosineWarmRestarts {
                first_period,
                factor,
                floor,
            } => {
                let (mut at, mut period) = (step, first_period.max(1));
                if factor <= 1 {
                    at %= period;
                }
                while at >= period {
                    at -= period;
                    period = period.saturating_mul(factor);
                }
                peak * cosine(at as f64 / period as f64, floor)
            }
        }
    }

    /// Refuses a useless schedule.
    ///
    /// # Errors
    /// [`PolicyError::Options`] names the value.
    pub fn check(self) -> Result<()> {
        let wrong = |what: String| Err(PolicyError::Options(what));
        match self {
            Self::Constant => Ok(()),
            Self::WarmupCosine { decay: 0, .. } => wrong("the schedule's decay has 0 steps".into()),
            Self::WarmupCosine { warmup, decay, .. } if warmup > decay => wrong(format!(
                "the schedule's warm-up of {warmup} steps is longer than its decay of {decay}"
            )),
            Self::CosineWarmRestarts {
                first_period: 0, ..
            } => wrong("the schedule's first period has 0 steps".into()),
            Self::CosineWarmRestarts { factor: 0, .. } => {
                wrong("the schedule's periods grow by a factor of 0; it must be 1 or more".into())
            }
            Self::WarmupCosine { floor, .. } | Self::CosineWarmRestarts { floor, .. }
                if !(0.0..=1.0).contains(&floor) =>
            {
                wrong(format!(
                    "the schedule's floor is {floor}; it is a share of the peak, 0 to 1"
                ))
            }
            _ => Ok(()),
        }
    }
}

/// From 1 at progress 0 to `floor` at progress 1.
fn cosine(progress: f64, floor: f64) -> f64 {
    (1.0 - floor) * 0.5 * (1.0 + (PI * progress).cos()) + floor
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn restarts_begin_at_the_peak_and_grow() {
        let schedule = Schedule::CosineWarmRestarts {
            first_period: 4,
            factor: 2,
            floor: 0.1,
        };
        let rates: Vec<f64> = (0..29)
            .map(|step| schedule.learning_rate(2.0, step, 29))
            .collect();
        // The periods' starts.
        for start in [0, 4, 12, 28] {
            assert_eq!(rates[start], 2.0, "step {start}");
        }
        for middle in [2, 8, 20] {
            assert!((rates[middle] - 2.0 * 0.55).abs() < 1e-12, "step {middle}");
        }
        // torch.optim.lr_scheduler.CosineAnnealingWarmRestarts's value.
        let last = 2.0 * (0.9 * (1.0 + (0.75 * PI).cos()) / 2.0 + 0.1);
        assert!((rates[3] - last).abs() < 1e-12);
        assert!(rates.iter().all(|rate| (0.2..=2.0).contains(rate)));
    }

    #[test]
    fn restarts_of_one_length_repeat() {
        let schedule = Schedule::CosineWarmRestarts {
            first_period: 5,
            factor: 1,
            floor: 0.0,
        };
        let rate = |step| schedule.learning_rate(1.0, step, 0);
        assert!((0..5).all(|step| rate(step) == rate(step + 5_000_000_000)));
    }

    #[test]
    fn schedules_that_make_no_sense_are_refused() {
        let refused = |schedule: Schedule| schedule.check().unwrap_err().to_string();
        let cosine = |warmup, decay, floor| Schedule::WarmupCosine {
            warmup,
            decay,
            floor,
        };
        let restarts = |first_period, factor, floor| Schedule::CosineWarmRestarts {
            first_period,
            factor,
            floor,
        };
        assert!(refused(cosine(0, 0, 0.0)).contains("0 steps"));
        assert!(refused(cosine(5, 4, 0.0)).contains("longer"));
        assert!(refused(cosine(1, 4, 1.5)).contains("floor is 1.5"));
        assert!(refused(cosine(1, 4, f64::NAN)).contains("floor is NaN"));
        assert!(refused(restarts(0, 2, 0.0)).contains("first period"));
        assert!(refused(restarts(4, 0, 0.0)).contains("factor of 0"));
        assert!(refused(restarts(4, 2, -0.1)).contains("floor is -0.1"));
        assert!(Schedule::LEROBOT.check().is_ok());
        assert!(Schedule::Constant.check().is_ok());
    }
}
