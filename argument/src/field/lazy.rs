//! Arithmetic for the prover's inner loops: results are brought below the modulus as late as possible, and without branches.

use super::coefficients::{product, wrapping_sum, SQUARE};
use super::extension::Extension;
use super::goldilocks::{reduce, Goldilocks};

/// A sum of products of 64 bits each, of which there are up to 2^32.
#[derive(Clone, Copy, Default)]
struct WideProducts {
    sum: u128,
    carries: u64,
}

impl WideProducts {
    #[inline(always)]
    fn add(&mut self, a: Goldilocks, b: Goldilocks) {
        let (sum, carry) = self.sum.overflowing_add(product(a, b));
        self.sum = sum;
        self.carries += carry as u64;
    }

    #[inline(always)]
    fn reduce(self) -> Goldilocks {
        // 2^128 = −2^32 in the field
        reduce(self.sum) - Goldilocks::canonical(self.carries << 32)
    }
}

/// A sum of products of the extension.
#[derive(Clone, Copy, Default)]
pub struct LazySum {
    /// Of the constant coefficients.
    constant: WideProducts,
    /// Of the linear coefficients, which x² goes with.
    square: WideProducts,
    linear: WideProducts,
}

impl LazySum {
    /// Adds `a · b`.
    #[inline(always)]
    pub fn add(&mut self, a: Extension, b: Extension) {
        self.constant.add(a.0[0], b.0[0]);
        self.square.add(a.0[1], b.0[1]);
        self.linear.add(a.0[0], b.0[1]);
        self.linear.add(a.0[1], b.0[0]);
    }

    /// Adds `a · b`.
    #[inline(always)]
    pub fn add_scaled(&mut self, a: Extension, b: Goldilocks) {
        self.constant.add(a.0[0], b);
        self.linear.add(a.0[1], b);
    }

    /// The sum.
    #[inline(always)]
    pub fn reduce(self) -> Extension {
        let square = self.square.reduce().value() as u128 * SQUARE;
        Extension([
            self.constant.reduce() + reduce(square),
            self.linear.reduce(),
        ])
    }
}

/// An element that many others are multiplied with.
#[derive(Clone, Copy)]
pub struct LazyFactor {
    factor: Extension,
    /// Its linear coefficient times x².
    square: Goldilocks,
}

impl LazyFactor {
    /// Prepares `factor`.
    pub fn new(factor: Extension) -> Self {
        let square = reduce(factor.0[1].value() as u128 * SQUARE);
        Self { factor, square }
    }

    /// `summand + factor · value`.
    #[inline(always)]
    pub fn times_plus(&self, value: Extension, summand: Extension) -> Extension {
        let ([f0, f1], [v0, v1], [s0, s1]) = (self.factor.0, value.0, summand.0);
        // A product and a summand stay below 2^128.
        let constant = product(f0, v0) + s0.value() as u128;
        let linear = product(f0, v1) + s1.value() as u128;
        Extension([
            reduce(wrapping_sum(constant, product(self.square, v1))),
            reduce(wrapping_sum(linear, product(f1, v0))),
        ])
    }

    /// `zero + factor · (one − zero)`.
    #[inline(always)]
    pub fn between(&self, zero: Extension, one: Extension) -> Extension {
        self.times_plus(one - zero, zero)
    }

    /// `zero + factor · (one − zero)`.
    #[inline(always)]
    pub fn between_base(&self, zero: Goldilocks, one: Goldilocks) -> Extension {
        let difference = one - zero;
        let [f0, f1] = self.factor.0;
        Extension([
            reduce(product(f0, difference) + zero.value() as u128),
            reduce(product(f1, difference)),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::goldilocks::P;

    #[test]
    fn results_are_those_of_plain_arithmetic() {
        let elements: Vec<Goldilocks> = [0, 1, 2, 1 << 32, P / 2, P - (1 << 32), P - 2, P - 1]
            .into_iter()
            .filter_map(Goldilocks::from_canonical)
            .collect();
        let pairs = elements
            .iter()
            .flat_map(|&a| elements.iter().map(move |&b| [a, b]));
        let extensions: Vec<Extension> = pairs.map(Extension).collect();
        let mut sum = LazySum::default();
        let mut plain = Extension::ZERO;
        for &a in &extensions {
            let factor = LazyFactor::new(a);
            for &b in &extensions {
                sum.add(a, b);
                plain += a * b;
                assert_eq!(sum.reduce(), plain);
                sum.add_scaled(a, b.0[0]);
                plain += a.scale(b.0[0]);
                for &c in extensions.iter().step_by(3) {
                    assert_eq!(factor.times_plus(b, c), a * b + c);
                    assert_eq!(factor.between(b, c), b + a * (c - b));
                    let (zero, one) = (b.0[0], c.0[1]);
                    let expected = Extension::from(zero) + a.scale(one - zero);
                    assert_eq!(factor.between_base(zero, one), expected);
                }
            }
        }
    }
}
