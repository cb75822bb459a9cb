//! The evaluation as [`zk0_circuits::model::eval`] does it, with the sums kept that the residual stream is made of.

use zk0_circuits::model::arithmetic::products::Rows;
use zk0_circuits::model::draw::Draw;
use zk0_circuits::model::eval::{EvalError, Evaluator, LossSum, Site};
use zk0_circuits::model::linear::{first_of_layer, place, Linear};
use zk0_circuits::model::multiply::{Direct, Multiply};
use zk0_circuits::{QuantisedWeights, Sample};

/// The sums of a linear layer, by its number: one matrix after the other, a row of outputs for each row of the input.
pub type Kept = (usize, Vec<i32>);

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
    kept: Vec<Kept>,
    /// The largest difference between scores that a token sees.
    apart: i64,
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
        queries: Rows<'_>,
        keys: Rows<'_>,
        visible: impl Fn(usize) -> usize,
    ) -> Vec<i64> {
        let scores = self.direct.scores(queries, keys, &visible);
        for (query, row) in scores.chunks_exact(keys.count()).enumerate() {
            let seen = row[..visible(query)].iter().copied();
            let most = seen.clone().max().unwrap_or_default();
            self.apart = seen.fold(self.apart, |apart, score| apart.max(most - score));
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

/// The loss of a sample, and the sums that the residual stream is made of, in the order of the evaluation.
pub fn trace(
    evaluator: &Evaluator<'_>,
    weights: &QuantisedWeights,
    sample: &Sample,
    draw: &Draw,
) -> Result<(LossSum, Vec<Kept>), EvalError> {
    let mut keeping = Keeping {
        direct: evaluator.direct(weights)?,
        kept: vec![],
    };
    let loss = evaluator.loss(&mut keeping, sample, draw)?;
    Ok((loss, keeping.kept))
}
