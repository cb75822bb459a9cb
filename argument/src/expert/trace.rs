//! The evaluation as [`zk0_circuits::model::eval`] does it, with the sums kept that the residual stream is made of.

use super::evaluation::attention::{factor, shift};
use super::sizes::{Sizes, X};
use zk0_circuits::claim::terms::Model;
use zk0_circuits::model::arithmetic::products::Rows;
use zk0_circuits::model::draw::Draw;
use zk0_circuits::model::eval::{EvalError, Evaluator, LossSum, Overflow, Site};
use zk0_circuits::model::linear::{first_of_layer, place, Linear};
use zk0_circuits::model::multiply::{Direct, Multiply};
use zk0_circuits::{EvalSpec, QuantisedWeights, Sample};

/// The sums of a linear layer, by its number: one matrix after the other, a row of outputs for each row of the input.
pub type LinearSums = (usize, Vec<i32>);

/// The linear layer whose outputs enter layer 0.
pub const EMBEDDED: usize = 2;

/// Whether the outputs of a linear layer are added to the residual stream, or are its beginning.
fn is_on_stream(index: usize) -> bool {
    match index.checked_sub(first_of_layer(0)) {
        None => index == EMBEDDED,
        Some(inner) => matches!(inner % place::COUNT, place::OUT | place::DOWN),
    }
}

/// Computes products, and keeps the sums of the residual stream.
struct Keeping<'a> {
    direct: Direct<'a>,
    spec: &'a EvalSpec,
    kept: Vec<LinearSums>,
    /// Whether scores lie further apart than the table of powers reaches.
    apart: bool,
}

impl Multiply for Keeping<'_> {
    fn overflow(&self) -> Overflow {
        self.direct.overflow()
    }

    fn gain(&self, index: usize) -> (&[i16], i16) {
        self.direct.gain(index)
    }

    fn linear(
        &mut self,
        index: usize,
        linear: &Linear,
        input: &[i16],
    ) -> Result<Vec<i32>, EvalError> {
        let sums = self.direct.linear(index, linear, input)?;
        if is_on_stream(index) {
            self.kept.push((index, sums.clone()));
        }
        Ok(sums)
    }

    fn scores(
        &mut self,
        layer: usize,
        queries: Rows<'_>,
        keys: Rows<'_>,
        visible: impl Fn(usize) -> usize,
    ) -> Vec<i64> {
        let scores = self.direct.scores(layer, queries, keys, &visible);
        let scales = &self.spec.layers[layer];
        let shift = shift((scales.query + scales.key).into());
        let reach = 1 << Sizes::new(self.spec, 1).of(X);
        for (query, row) in scores.chunks_exact(keys.count()).enumerate() {
            let seen = row[..visible(query)].iter();
            if let (Some(most), Some(least)) = (seen.clone().max(), seen.min()) {
                let distance = ((most - least) * factor(self.spec.dims.head_dim)) >> shift;
                self.apart |= distance >= reach;
            }
        }
        scores
    }

    fn mix(
        &mut self,
        site: Site,
        weights: Rows<'_>,
        values: Rows<'_>,
    ) -> Result<Vec<i32>, EvalError> {
        self.direct.mix(site, weights, values)
    }
}

/// What an evaluation gives.
pub struct Traced {
    /// The loss.
    pub loss: LossSum,
    /// The sums that the residual stream is made of, in the order of the evaluation.
    pub kept: Vec<LinearSums>,
    /// Whether an argument about it has to be one of a statement that saturates.
    pub saturates: bool,
}

/// Evaluates a model on a sample.
pub fn trace(
    evaluator: &Evaluator<'_>,
    model: Model,
    weights: &QuantisedWeights,
    sample: &Sample,
    draw: &Draw,
) -> Result<Traced, EvalError> {
    let with = |overflow| {
        let mut keeping = Keeping {
            direct: evaluator.direct(weights, overflow)?,
            spec: evaluator.spec,
            kept: vec![],
            apart: false,
        };
        let loss = evaluator.loss(&mut keeping, sample, draw)?;
        Ok(Traced {
            loss,
            kept: keeping.kept,
            saturates: keeping.apart || overflow == Overflow::Saturated,
        })
    };
    match (with(Overflow::Refused), model.overflow()) {
        (Err(EvalError::OutOfRange { .. }), Overflow::Saturated) => with(Overflow::Saturated),
        (result, _) => result,
    }
}
