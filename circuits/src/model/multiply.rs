//! The matrix products of the evaluation. [`Direct`] computes them. Whoever wants to see the sums on the way wraps it, as mode `succinct` does
//! to find the values of its argument.

use crate::model::arithmetic::products::{products, Rows};
use crate::model::layout::Layout;
use crate::model::linear::{Linear, HALF, SUM_BITS};
use crate::model::site::{EvalError, Narrowing, Overflow, Site};
use crate::model::spec::EvalSpec;
use crate::model::weights::QuantisedWeights;
use alloc::vec;
use alloc::vec::Vec;

/// A set of weights, and the products with them.
pub trait Multiply {
    /// What becomes of a value of this model that does not fit.
    fn overflow(&self) -> Overflow;

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

    /// `queries · keysᵀ` of a layer, one row per query, of which the first `visible(i)` scores of query `i` are used.
    fn scores(
        &mut self,
        layer: usize,
        queries: Rows<'_>,
        keys: Rows<'_>,
        visible: impl Fn(usize) -> usize,
    ) -> Vec<i64>;

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
    overflow: Overflow,
}

impl<'a> Direct<'a> {
    /// Products with `weights`, which were quantised for `spec`.
    pub(crate) fn new(
        spec: &'a EvalSpec,
        layout: &'a Layout,
        weights: &'a QuantisedWeights,
        overflow: Overflow,
    ) -> Result<Self, EvalError> {
        if weights.values.len() != layout.len {
            return Err(EvalError::Dimensions("the weights"));
        }
        Ok(Self {
            spec,
            layout,
            weights,
            overflow,
        })
    }
}

impl Multiply for Direct<'_> {
    fn overflow(&self) -> Overflow {
        self.overflow
    }

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
            fit.check(output.site, self.overflow)?;
        }
        Ok(sums)
    }

    fn scores(
        &mut self,
        _: usize,
        queries: Rows<'_>,
        keys: Rows<'_>,
        _: impl Fn(usize) -> usize,
    ) -> Vec<i64> {
        let mut sums = vec![0; queries.count() * keys.count()];
        products(queries, keys, |at, _, sum| sums[at] = sum);
        sums
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
        fit.check(site, self.overflow)?;
        Ok(sums)
    }
}

/// Narrows sums to int32, and remembers the first that does not fit.
struct Fit {
    overflown: Option<i64>,
}

impl Fit {
    fn new() -> Self {
        Self { overflown: None }
    }

    #[inline(always)]
    fn fit(&mut self, sum: i64) -> i32 {
        let fitted = sum as i32;
        if fitted as i64 == sum {
            fitted
        } else {
            self.saturated(sum)
        }
    }

    #[cold]
    #[inline(never)]
    fn saturated(&mut self, sum: i64) -> i32 {
        self.overflown.get_or_insert(sum);
        sum.clamp(i32::MIN.into(), i32::MAX.into()) as i32
    }

    fn check(self, site: Site, overflow: Overflow) -> Result<(), EvalError> {
        let at = Narrowing { site, overflow };
        self.overflown
            .map_or(Ok(()), |sum| at.overflown(sum >> SUM_BITS))
    }
}
