//! Averages that a few bad updates cannot move far: the median and the trimmed mean of each parameter (Yin et al., 2018,
//! arXiv:1803.01498).
//!
//! Contributors count alike: weights by samples would make the one with the largest claim the median. Integers are exact, so the
//! order does not matter.

use crate::combine::blocks::{Combination, Integer, Plan};
use crate::combine::contributions::WeightedContribution;
use crate::combine::error::CombineError;
use crate::combine::optimizers::moments::Moment;
use crate::combine::source::{Block, BlockBuffer, WeightSource};
use std::ops::Range;
use zk0_protocol::rules::basis_points::BPS;
use zk0_weights::rounding::Unit;

/// Each parameter's mean without some of the largest and the smallest values.
pub struct MiddleMean<'a> {
    weights: Vec<&'a dyn WeightSource>,
    kept: Range<usize>,
}

/// Each parameter's median; for an even number, the mean of the middle two.
pub fn median<'a>(given: &[WeightedContribution<'a>]) -> MiddleMean<'a> {
    MiddleMean::new(given, given.len().saturating_sub(1) / 2)
}

/// Each parameter's mean without `trim_bps` basis points of the contributors, rounded down, at either end.
pub fn trimmed_mean<'a>(given: &[WeightedContribution<'a>], trim_bps: u32) -> MiddleMean<'a> {
    let share = trim_bps.min(BPS / 2 - 1) as usize;
    MiddleMean::new(given, given.len() * share / BPS as usize)
}

impl<'a> MiddleMean<'a> {
    fn new(given: &[WeightedContribution<'a>], left_out: usize) -> Self {
        Self {
            weights: given.iter().map(|one| one.weights).collect(),
            kept: left_out..given.len() - left_out,
        }
    }

    fn finest(&self, tensor: usize) -> i16 {
        let bits = self.weights.iter().map(|weights| weights.bits(tensor));
        bits.max().unwrap_or(0)
    }
}

impl Combination for MiddleMean<'_> {
    fn plan(&self, tensor: usize) -> Plan {
        let bits = self.finest(tensor);
        let coarsest = self
            .weights
            .iter()
            .map(|weights| weights.bits(tensor))
            .min();
        let largest = 1u128 << (15 + (bits - coarsest.unwrap_or(bits)).max(0));
        Plan {
            unit: Unit {
                bits,
                divisor: self.kept.len() as i128,
            },
            bound: largest * self.kept.len() as u128,
        }
    }

    fn combine<T: Integer>(
        &self,
        block: &Block,
        numbers: &mut [T],
        _: &mut [Moment],
        rows: &mut BlockBuffer,
    ) -> Result<(), CombineError> {
        let rows = rows.read(&self.weights, block)?;
        let finest = self.finest(block.tensor);
        let weights = self
            .weights
            .iter()
            .map(|weights| weights.bits(block.tensor));
        let shifts: Vec<_> = weights.map(|bits| (finest - bits).max(0)).collect();
        let mut column = vec![0i64; shifts.len()];
        for (at, number) in numbers.iter_mut().enumerate() {
            for ((place, row), shift) in column.iter_mut().zip(&rows).zip(&shifts) {
                *place = i64::from(row[at]) << shift;
            }
            column.sort_unstable();
            let sum: i64 = column[self.kept.clone()].iter().sum();
            *number = T::of(sum.into());
        }
        Ok(())
    }
}
