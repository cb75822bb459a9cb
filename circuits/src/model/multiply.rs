//! The matrix products of the evaluation. [`Direct`] computes them. Whoever wants to see the sums on the way wraps it, as mode `succinct` does
//! to find the values of its argument.

use crate::model::arithmetic::products::{products, Rows};
use crate::model::layout::Layout;
use crate::model::linear::{Linear, HALF, SUM_BITS};
use crate::model::site::{EvalError, Site};
use crate::model::spec::EvalSpec;
use crate::model::weights::QuantisedWeights;
use alloc::vec;
use alloc::vec::Vec;

/// A set of weights, and the products with them. Sums are int32, and a sum that does not fit is an error.
pub trait Multiply {
    /// The norm's gain that is number `index` of the expert's tensors: its values and their fraction bits.
    fn gain(&self, index: usize) -> (&[i16], i16);

    /// Returns the sums of linear layer number `index` ([`crate::model::linear::linears`]) over the rows of `input`:
    /// for each matrix, one row of outputs per row of input.
    fn linear(
        &mut self,
        index: usize,
        linear: &Linear,
        input: &[i16],
    ) -> Result<Vec<i32>, EvalError>;

    /// `queries · keysᵀ`, one row per query. Of the scores of query `i`, only the first `visible(i)` have to fit.
    fn scores(
        &mut self,
        site: Site,
        queries: Rows<'_>,
        keys: Rows<'_>,
        visible: impl Fn(usize) -> usize,
    ) -> Result<Vec<i32>, EvalError>;

    /// `weights · values · 2^`[`MIX_SHIFT`]` + 2^15`, one row per row of `weights`: their outputs have the fraction
    /// bits of `values`.
    fn mix(
        &mut self,
        site: Site,
        weights: Rows<'_>,
        values: Rows<'_>,
    ) -> Result<Vec<i32>, EvalError>;
}

/// Fraction bits of attention weights: 1 is 2^14.
pub const ATTENTION_BITS: u32 = 14;
/// The shift that brings attention weights times values to the scale of sums.
pub const MIX_SHIFT: u32 = SUM_BITS - ATTENTION_BITS;

/// Computes every product.
pub struct Direct<'a> {
    spec: &'a EvalSpec,
    layout: &'a Layout,
    weights: &'a QuantisedWeights,
}

impl<'a> Direct<'a> {
    /// Products with `weights`, which were quantised for `spec`.
    pub(crate) fn new(
        spec: &'a EvalSpec,
        layout: &'a Layout,
        weights: &'a QuantisedWeights,
    ) -> Result<Self, EvalError> {
        if weights.values.len() != layout.len {
            return Err(EvalError::Dimensions("the weights"));
        }
        Ok(Self {
            spec,
            layout,
            weights,
        })
    }
}

impl Multiply for Direct<'_> {
    fn gain(&self, index: usize) -> (&[i16], i16) {
        self.weights.tensor(self.layout, index)
    }

    fn linear(&mut self, _: usize, linear: &Linear, input: &[i16]) -> Result<Vec<i32>, EvalError> {
        let input = Rows::new(input, linear.columns);
        let mut sums = vec![0; input.count() * linear.rows()];
        let mut rest = &mut sums[..];
        for output in &linear.outputs {
            let (matrix, bits) = self.weights.tensor(self.layout, output.matrix);
            let rows = Rows::new(matrix, linear.columns).first(output.rows);
            let shift = output.shift(linear.bits, bits);
            let (now, later) = rest.split_at_mut(input.count() * output.rows);
            rest = later;
            let mut fit = Fit::new();
            match output.bias {
                None => products(input, rows, |at, _, sum| {
                    now[at] = fit.fit((sum << shift) + HALF);
                }),
                Some(bias) => {
                    let (bias, bits) = self.weights.tensor(self.layout, bias);
                    let bias_shift = output.bias_shift(bits);
                    products(input, rows, |at, column, sum| {
                        let bias = (bias[column] as i64) << bias_shift;
                        now[at] = fit.fit((sum << shift) + bias + HALF);
                    });
                }
            }
            fit.check(output.site, SUM_BITS)?;
        }
        Ok(sums)
    }

    fn scores(
        &mut self,
        site: Site,
        queries: Rows<'_>,
        keys: Rows<'_>,
        visible: impl Fn(usize) -> usize,
    ) -> Result<Vec<i32>, EvalError> {
        let mut sums = vec![0; queries.count() * keys.count()];
        let mut fit = Fit::new();
        products(queries, keys, |at, column, sum| {
            sums[at] = sum as i32;
            if sums[at] as i64 != sum && column < visible(at / keys.count()) {
                fit.refuse(sum);
            }
        });
        fit.check(site, 0)?;
        Ok(sums)
    }

    fn mix(
        &mut self,
        site: Site,
        weights: Rows<'_>,
        values: Rows<'_>,
    ) -> Result<Vec<i32>, EvalError> {
        let head_dim = self.spec.dims.head_dim as usize;
        let columns = values.transposed();
        let columns = Rows::new(&columns, values.count());
        let mut sums = vec![0; weights.count() * head_dim];
        let mut fit = Fit::new();
        products(weights, columns, |at, _, sum| {
            sums[at] = fit.fit((sum << MIX_SHIFT) + HALF);
        });
        fit.check(site, SUM_BITS)?;
        Ok(sums)
    }
}

/// Narrows sums to int32 and remembers the first that does not fit.
struct Fit {
    refused: Option<i64>,
}

impl Fit {
    fn new() -> Self {
        Self { refused: None }
    }

    #[inline(always)]
    fn fit(&mut self, sum: i64) -> i32 {
        let fitted = sum as i32;
        if fitted as i64 != sum {
            self.refuse(sum);
        }
        fitted
    }

    #[cold]
    #[inline(never)]
    fn refuse(&mut self, sum: i64) {
        self.refused.get_or_insert(sum);
    }

    fn check(self, site: Site, bits: u32) -> Result<(), EvalError> {
        match self.refused {
            None => Ok(()),
            Some(sum) => Err(EvalError::OutOfRange {
                site,
                value: sum >> bits,
            }),
        }
    }
}
