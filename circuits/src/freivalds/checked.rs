//! The product checks of mode `checked`. The products are hinted, and checked with random coefficients that are drawn after the
//! products were fixed (Freivalds, "Probabilistic machines can use less running time", IFIP 1977).
//!
//! Let S be the sums claimed for an input X and matrices W, and r the coefficients. The check is `S·r = X·u + rest·r`, where
//! `u = Σ 2^shift · Wᵀ·r` is a *projection* ([`crate::freivalds::projection`]), which is hinted here and recomputed by the
//! verifier, and `rest` is the bias and rounding. In attention the guest has both factors, and computes the projection itself.
//! See `SOUNDNESS.md`.

use crate::freivalds::coefficients::{
    combine_rows, rows_with_coefficients, rows_with_elements, Coefficients,
};
use crate::freivalds::field::{limbs, Element, Limbs};
use crate::model::arithmetic::products::Rows;
use crate::model::linear::{Linear, SUM_BITS};
use crate::model::multiply::{Multiply, MIX_SHIFT};
use crate::model::parameters::Parameters;
use crate::model::site::{EvalError, Site};
use crate::vm::budget::operation;
use alloc::vec;

/// The rounding constant of a sum is 2 to the power of this.
const HALF_BITS: u32 = SUM_BITS - 1;

/// Takes every product from hints and checks it.
pub struct Checked<'a> {
    /// Hinted sums not yet used.
    hints: &'a [i32],
    coefficients: &'a Coefficients,
    /// For each linear layer, one element per input column.
    projections: &'a [&'a [Limbs]],
    /// For each linear layer, its [`rest`].
    rests: &'a [Element],
}

/// Returns Σ (bias · 2^… + 2^15) · r over the outputs of `linear`: what a row of sums holds beside products.
pub fn rest(linear: &Linear, parameters: &Parameters, coefficients: &Coefficients) -> Element {
    let mut rest = Element::ZERO;
    let mut first = 0;
    for output in &linear.outputs {
        let sum = coefficients.sum(first, output.rows);
        rest = rest + sum.shift(HALF_BITS);
        if let Some(bias) = output.bias {
            let bias = parameters.vector(bias);
            let values = Rows::new(&bias.values[..output.rows], output.rows);
            for sum in rows_with_coefficients(values, coefficients.range(first, output.rows)) {
                rest = rest + sum.shift(output.bias_shift(bias.bits));
            }
        }
        first += output.rows;
    }
    rest
}

impl<'a> Checked<'a> {
    /// Takes products from `hints`. There is one entry of `projections` and `rests` for each linear layer.
    pub fn new(
        hints: &'a [i32],
        coefficients: &'a Coefficients,
        projections: &'a [&'a [Limbs]],
        rests: &'a [Element],
    ) -> Self {
        Self {
            hints,
            coefficients,
            projections,
            rests,
        }
    }

    /// Checks that every hint was used. One may be left, because the list is padded to an even number.
    pub fn finish(self) -> Result<(), EvalError> {
        match self.hints.len() {
            0 | 1 => Ok(()),
            left => Err(EvalError::Hints(left)),
        }
    }

    fn take(&mut self, count: usize) -> Result<&'a [i32], EvalError> {
        let (now, later) = self
            .hints
            .split_at_checked(count)
            .ok_or(EvalError::Hints(self.hints.len()))?;
        self.hints = later;
        Ok(now)
    }
}

impl<'a> Multiply for Checked<'a> {
    type Sums = &'a [i32];

    fn linear(
        &mut self,
        index: usize,
        linear: &Linear,
        input: &[i16],
    ) -> Result<&'a [i32], EvalError> {
        let _operation = operation("linear product checks");
        let input = Rows::new(input, linear.columns);
        let sums = self.take(input.count() * linear.rows())?;
        let mut combined = vec![Element::ZERO; input.count()];
        let (mut first, mut rest) = (0, sums);
        for output in &linear.outputs {
            let (now, later) = rest.split_at(input.count() * output.rows);
            rest = later;
            let coefficients = self.coefficients.range(first, output.rows);
            let now = rows_with_coefficients(Rows::new(now, output.rows), coefficients);
            for (sum, now) in combined.iter_mut().zip(now) {
                *sum = *sum + now;
            }
            first += output.rows;
        }
        let rest = self.rests[index];
        let products = rows_with_elements(input, self.projections[index]);
        let expected = products.into_iter().map(|product| product + rest);
        match linear.outputs.first() {
            Some(output) if !expected.eq(combined) => Err(EvalError::Product(output.site)),
            _ => Ok(sums),
        }
    }

    fn scores(
        &mut self,
        site: Site,
        queries: Rows<'_>,
        keys: Rows<'_>,
    ) -> Result<&'a [i32], EvalError> {
        let _operation = operation("attention product checks");
        let sums = self.take(queries.count() * keys.count())?;
        let coefficients = self.coefficients.range(0, keys.count());
        let projection = limbs(&combine_rows(keys, coefficients));
        let combined = rows_with_coefficients(Rows::new(sums, keys.count()), coefficients);
        if rows_with_elements(queries, &projection) != combined {
            return Err(EvalError::Product(site));
        }
        Ok(sums)
    }

    fn mix(
        &mut self,
        site: Site,
        weights: Rows<'_>,
        values: Rows<'_>,
    ) -> Result<&'a [i32], EvalError> {
        let _operation = operation("attention product checks");
        let columns = values.columns();
        let sums = self.take(weights.count() * columns)?;
        let coefficients = self.coefficients.range(0, columns);
        let projection = limbs(&rows_with_coefficients(values, coefficients));
        let combined = rows_with_coefficients(Rows::new(sums, columns), coefficients);
        let rest = self.coefficients.sum(0, columns).shift(HALF_BITS);
        let products = rows_with_elements(weights, &projection);
        let expected = products
            .into_iter()
            .map(|product| product.shift(MIX_SHIFT) + rest);
        if !expected.eq(combined) {
            return Err(EvalError::Product(site));
        }
        Ok(sums)
    }
}
