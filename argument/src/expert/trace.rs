//! The evaluation as [`zk0_circuits::model::eval`] does it, with the sums of those linear layers kept from which the residual stream follows.

use zk0_circuits::model::arithmetic::products::Rows;
use zk0_circuits::model::draw::Draw;
use zk0_circuits::model::eval::{EvalError, Evaluator, LossSum, Site};
use zk0_circuits::model::linear::{first_of_layer, place, Linear};
use zk0_circuits::model::multiply::{Direct, Multiply};
use zk0_circuits::model::parameters::Parameters;
use zk0_circuits::{QuantisedWeights, Sample};

/// The sums of a linear layer, by its number: one matrix after the other, a row of outputs for each row of the input.
pub type Kept = (usize, Vec<i32>);

/// Whether the residual stream follows from the sums of a linear layer. Those of the others would take more than four times as much memory for each sample.
fn is_kept(index: usize) -> bool {
    match index.checked_sub(first_of_layer(0)) {
        None => true,
        Some(index) => [place::OUT, place::DOWN].contains(&(index % place::COUNT)),
    }
}

/// Computes products, and keeps sums.
struct Keeping<'a> {
    direct: Direct<'a>,
    kept: Vec<Kept>,
}

impl Multiply for Keeping<'_> {
    type Sums = Vec<i32>;

    fn linear(
        &mut self,
        index: usize,
        linear: &Linear,
        input: &[i16],
    ) -> Result<Vec<i32>, EvalError> {
        let sums = self.direct.linear(index, linear, input)?;
        if is_kept(index) {
            self.kept.push((index, sums.clone()));
        }
        Ok(sums)
    }

    fn scores(
        &mut self,
        site: Site,
        queries: Rows<'_>,
        keys: Rows<'_>,
    ) -> Result<Vec<i32>, EvalError> {
        self.direct.scores(site, queries, keys)
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

/// The loss of a sample, and the sums on the way to it that are kept, in the order of the evaluation.
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
    let parameters = Parameters::of(evaluator.spec, weights);
    let loss = evaluator.loss(&parameters, &mut keeping, sample, draw)?;
    Ok((loss, keeping.kept))
}
