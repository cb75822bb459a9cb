//! FedAdam: federated averaging as a step of Adam (Reddi et al., 2021, arXiv:2003.00295, algorithm 2).
//!
//! With the base x of the round and the mean of its updates, the pseudo-gradient is Δ = mean − x. Each weight is computed by
//!
//! `m ← β₁·m + (1 − β₁)·Δ`, `v ← β₂·v + (1 − β₂)·Δ²`, `x ← x + η_t · m / (√v + τ)`
//!
//! with `η_t = η · √(1 − β₂^(t+1)) / (1 − β₁^(t+1))` in the t-th round since the moments began, from 1. The paper has a constant
//! η. The factor corrects the bias of moments that began with 0 (Kingma and Ba, 2015), as in Flower's FedAdam.
//!
//! **Where the moments are.** m and v depend on all rounds since they began. Unlike momentum ([`super::momentum`]) they do not
//! follow from the ledger's weights: v is no movement, and a movement divided by η_t / (√v + τ) gives m only up to the rounding
//! of int16, which exceeds most Δ. So they are a blob ([`super::moments`]). A ledger entry before the round's closing has its
//! digest, and anyone with the updates can recompute it.
//!
//! **The same bits on every machine.** Δ is an exact integer over a divisor ([`LinearCombination`]). Every later step is one IEEE
//! 754 float64 operation in the order of [`Adam::step`]: sum, difference, product, quotient and square root are correctly rounded
//! everywhere, and none are fused. The moments are rounded to float32, the step to a multiple of 2^−40. It is added to x exactly,
//! and the sum is rounded once.

use crate::combine::blocks::{Combination, Integer, Plan};
use crate::combine::contributions::WeightedContribution;
use crate::combine::error::CombineError;
use crate::combine::fedavg::whole;
use crate::combine::linear::{LinearCombination, ScaledWeights};
use crate::combine::optimizers::moments::Moment;
use crate::combine::source::{Block, BlockBuffer, WeightSource};
use zk0_circuits::model::layout::MAX_WEIGHT_BITS;
use zk0_protocol::rules::basis_points::BPS;
use zk0_protocol::rules::network_rules::BILLIONTHS;
use zk0_weights::rounding::{exact, Unit};

/// The step's fraction bits beyond the weights' finest scale.
const MORE_BITS: i16 = 16;

/// The largest step. It exceeds every weight, so a larger one changes nothing.
const LARGEST_STEP: f64 = 65536.0;

/// The parameters in the rules.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AdamParameters {
    /// η, in billionths.
    pub server_rate_billionths: u32,
    /// β₁, in basis points.
    pub beta1_bps: u32,
    /// β₂, in basis points.
    pub beta2_bps: u32,
    /// τ, in billionths.
    pub tau_billionths: u32,
}

/// The result of a round by FedAdam.
pub struct Adam<'a> {
    /// The mean of the updates, less the base.
    difference: LinearCombination<'a>,
    base: &'a dyn WeightSource,
    first: Decay,
    second: Decay,
    rate: f64,
    tau: f64,
}

/// How a moment follows from the last: `kept · before + added · new`.
#[derive(Clone, Copy)]
struct Decay {
    kept: f64,
    added: f64,
}

impl Decay {
    fn of(bps: u32) -> Self {
        let part = |bps: u32| f64::from(bps) / f64::from(BPS);
        Self {
            kept: part(bps),
            added: part(BPS - bps.min(BPS)),
        }
    }

    fn next(self, before: f32, new: f64) -> f32 {
        (self.kept * f64::from(before) + self.added * new) as f32
    }

    /// The sum after `count` rounds that add 1 each: 1 − kept^count.
    fn reached(self, count: u64) -> f64 {
        let mut power = 1.0;
        for _ in 0..count {
            power *= self.kept;
            if 1.0 - power == 1.0 {
                break;
            }
        }
        1.0 - power
    }
}

/// The result of a round from `base`; the moments have `steps` rounds.
pub fn adam<'a>(
    given: &[WeightedContribution<'a>],
    base: &'a dyn WeightSource,
    parameters: AdamParameters,
    steps: u64,
) -> Result<Adam<'a>, CombineError> {
    let whole = whole(given)?;
    let mean = given.iter().map(|one| ScaledWeights {
        coefficient: one.weight.into(),
        weights: one.weights,
    });
    let less = ScaledWeights {
        coefficient: -whole,
        weights: base,
    };
    let part = |billionths: u32| f64::from(billionths) / f64::from(BILLIONTHS);
    let first = Decay::of(parameters.beta1_bps);
    let second = Decay::of(parameters.beta2_bps);
    let counted = steps.saturating_add(2);
    let rate = part(parameters.server_rate_billionths);
    Ok(Adam {
        difference: LinearCombination::new(mean.chain([less]), whole),
        base,
        rate: rate * second.reached(counted).sqrt() / first.reached(counted),
        first,
        second,
        tau: part(parameters.tau_billionths),
    })
}

impl Adam<'_> {
    /// Advances a weight's moments by a round, and returns the step in units of 2^−40.
    fn step(&self, moment: &mut Moment, difference: f64) -> i64 {
        moment.first = self.first.next(moment.first, difference);
        moment.second = self.second.next(moment.second, difference * difference);
        let spread = f64::from(moment.second).sqrt() + self.tau;
        let step = self.rate * f64::from(moment.first) / spread;
        let step = step.clamp(-LARGEST_STEP, LARGEST_STEP);
        (step * power_of_two(MAX_WEIGHT_BITS + MORE_BITS)).round_ties_even() as i64
    }
}

/// 2^`bits`, for at most 62 bits.
fn power_of_two(bits: i16) -> f64 {
    (1u64 << bits) as f64
}

impl Combination for Adam<'_> {
    fn plan(&self, tensor: usize) -> Plan {
        Plan {
            unit: Unit {
                bits: MAX_WEIGHT_BITS,
                divisor: 1 << MORE_BITS,
            },
            // A weight is below 2^55 in these units, and a step is at most 2^56.
            bound: self.difference.plan(tensor).bound.max(1 << 57),
        }
    }

    fn combine<T: Integer>(
        &self,
        block: &Block,
        numbers: &mut [T],
        moments: &mut [Moment],
        rows: &mut BlockBuffer,
    ) -> Result<(), CombineError> {
        self.difference.combine(block, numbers, &mut [], rows)?;
        let unit = self.difference.plan(block.tensor).unit;
        let divisor = unit.divisor as f64 * power_of_two(unit.bits);
        let (base, bits) = ([self.base], self.base.bits(block.tensor));
        let base = rows.read(&base, block)?[0];
        for ((number, value), moment) in numbers.iter_mut().zip(base).zip(moments) {
            let step = self.step(moment, number.nearest() / divisor);
            *number = T::of(i128::from((exact(*value, bits) << MORE_BITS) + step));
        }
        Ok(())
    }
}
