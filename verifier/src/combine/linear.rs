//! Sums of weights with integer coefficients, over one divisor: FedAvg, Krum, norm clipping, momentum, and Adam's gradient.

use crate::combine::blocks::{Combination, Integer, Plan};
use crate::combine::error::CombineError;
use crate::combine::optimizers::moments::Moment;
use crate::combine::source::{Block, BlockBuffer, WeightSource};
use zk0_weights::rounding::Unit;

/// Terms summed together: their blocks and the sums fit into a core's cache.
const AT_ONCE: usize = 4;

/// Weights times a number.
#[derive(Clone, Copy)]
pub struct ScaledWeights<'a> {
    /// The number, below 2^86 in magnitude.
    pub coefficient: i128,
    /// The weights.
    pub weights: &'a dyn WeightSource,
}

/// A sum of scaled weights over one divisor.
pub struct LinearCombination<'a> {
    terms: Vec<ScaledWeights<'a>>,
    divisor: i128,
}

impl<'a> LinearCombination<'a> {
    /// The sum of `terms`, divided by `divisor`, which is positive and below 2^100.
    ///
    /// Their common divisor is removed, because smaller integers are faster: equal shares count 1 instead of 10,000.
    pub fn new(terms: impl IntoIterator<Item = ScaledWeights<'a>>, divisor: i128) -> Self {
        let terms = terms.into_iter().filter(|term| term.coefficient != 0);
        let mut terms: Vec<_> = terms.collect();
        let coefficients = terms.iter().map(|term| term.coefficient.unsigned_abs());
        let common = coefficients.fold(divisor.unsigned_abs(), common_divisor) as i128;
        for term in &mut terms {
            term.coefficient /= common;
        }
        Self {
            terms,
            divisor: divisor / common,
        }
    }

    /// The tensor's finest scale in any of the weights.
    fn finest(&self, tensor: usize) -> i16 {
        let bits = self.terms.iter().map(|term| term.weights.bits(tensor));
        bits.max().unwrap_or(0)
    }
}

fn common_divisor(mut one: u128, mut other: u128) -> u128 {
    while other != 0 {
        (one, other) = (other, one % other);
    }
    one
}

impl ScaledWeights<'_> {
    /// The factor that brings a value of this tensor to `bits` fraction bits.
    fn factor(&self, tensor: usize, bits: i16) -> i128 {
        self.coefficient << (bits - self.weights.bits(tensor)).max(0)
    }
}

impl Combination for LinearCombination<'_> {
    fn plan(&self, tensor: usize) -> Plan {
        let bits = self.finest(tensor);
        let factors = self.terms.iter().map(|term| term.factor(tensor, bits));
        let factors: u128 = factors.map(i128::unsigned_abs).sum();
        Plan {
            unit: Unit {
                bits,
                divisor: self.divisor,
            },
            bound: factors.saturating_mul(1 << 15),
        }
    }

    fn combine<T: Integer>(
        &self,
        block: &Block,
        numbers: &mut [T],
        _: &mut [Moment],
        rows: &mut BlockBuffer,
    ) -> Result<(), CombineError> {
        let bits = self.finest(block.tensor);
        for terms in self.terms.chunks(AT_ONCE) {
            let weights = terms.iter().map(|term| term.weights);
            let factors = terms.iter().map(|term| term.factor(block.tensor, bits));
            let (weights, factors): (Vec<_>, Vec<_>) = weights.zip(factors).unzip();
            T::add_products(numbers, &factors, &rows.read(&weights, block)?);
        }
        Ok(())
    }
}
