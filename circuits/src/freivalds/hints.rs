//! Hinted products: what enters the guest of a set of weights in mode `checked`, and the evaluation with it.

use crate::claim::terms::Model;
use crate::freivalds::checked::{rest, Checked};
use crate::freivalds::coefficients::Coefficients;
use crate::freivalds::field::{Element, Limbs};
use crate::freivalds::projection;
use crate::model::draw::Draw;
use crate::model::eval::{Evaluator, LossSum};
use crate::model::multiply::Recorder;
use crate::model::parameters::Parameters;
use crate::model::sample::Sample;
use crate::model::site::EvalError;
use crate::model::weights::QuantisedWeights;
use crate::vm::budget::operation;
use crate::vm::digest::Digest;
use crate::vm::poseidon2::{hash_words, Domain};
use alloc::borrow::Cow;
use alloc::vec;
use alloc::vec::Vec;

/// What enters the guest of a set of weights, and the hints of its products.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HintedWeights<'a> {
    /// Gains and biases.
    pub parameters: Parameters,
    /// Projections of the matrices, as [`projection::project`] computes them.
    pub projections: Cow<'a, [u64]>,
    /// For each opening, the sums of all products.
    pub hints: Vec<Hints<'a>>,
}

/// Hinted sums of one evaluation, in the order of evaluation, zero-padded to 8 bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hints<'a>(pub(crate) Cow<'a, [u64]>);

impl Hints<'static> {
    /// The prover's side: evaluates, and keeps the sums of all products. If a value of the base overflows between two products, these
    /// are the products before it: the guest finds the same overflow.
    ///
    /// # Errors
    /// A value of the update overflows, or a product of either.
    pub fn record(
        evaluator: &Evaluator<'_>,
        model: Model,
        weights: &QuantisedWeights,
        parameters: &Parameters,
        sample: &Sample,
        draw: &Draw,
    ) -> Result<Self, EvalError> {
        let mut recorder = Recorder::new(evaluator.direct(weights)?);
        match evaluator.loss(parameters, &mut recorder, sample, draw) {
            Err(EvalError::OutOfRange { .. }) if model == Model::Base && !recorder.missing => {}
            evaluated => drop(evaluated?),
        }
        Ok(Self::new(&recorder.hints))
    }
}

impl Hints<'_> {
    /// Copies `sums`.
    pub fn new(sums: &[i32]) -> Self {
        let mut words = vec![0u64; sums.len().div_ceil(2)];
        bytemuck::cast_slice_mut::<u64, i32>(&mut words)[..sums.len()].copy_from_slice(sums);
        Self(Cow::Owned(words))
    }

    /// The sums; a zero may follow the last one.
    pub fn sums(&self) -> &[i32] {
        bytemuck::cast_slice(&self.0)
    }

    /// The sums, to be changed.
    pub fn sums_mut(&mut self) -> &mut [i32] {
        bytemuck::cast_slice_mut(self.0.to_mut())
    }

    /// Poseidon2 digest, each sum as two int16.
    pub fn digest(&self) -> Digest {
        hash_words(Domain::Hints, &self.0, 4 * self.0.len() as u64)
    }
}

/// Expands the coefficients of a seed, as many as the products take.
pub fn coefficients(evaluator: &Evaluator<'_>, seed: &Digest) -> Coefficients {
    let _operation = operation("coefficients");
    let count = projection::coefficient_count(&evaluator.spec.dims, &evaluator.linears);
    Coefficients::expand(seed, count)
}

impl HintedWeights<'_> {
    /// The projections as field elements.
    pub fn projections(&self) -> &[Limbs] {
        self.projections.as_chunks().0
    }
}

/// The hinted products of one set of weights, prepared for the checks.
pub struct Products<'a> {
    evaluator: &'a Evaluator<'a>,
    weights: &'a HintedWeights<'a>,
    coefficients: &'a Coefficients,
    /// For each linear layer its projection; `None` if there are too few or too many.
    projections: Option<Vec<&'a [Limbs]>>,
    /// For each linear layer what a row of sums holds beside products.
    rests: Vec<Element>,
}

impl<'a> Products<'a> {
    /// Prepares the products of `weights` to be checked with `coefficients`.
    pub fn new(
        evaluator: &'a Evaluator<'a>,
        weights: &'a HintedWeights<'a>,
        coefficients: &'a Coefficients,
    ) -> Self {
        let linears = evaluator.linears.iter();
        Self {
            evaluator,
            weights,
            coefficients,
            projections: projection::by_linear(&evaluator.linears, weights.projections()),
            rests: linears
                .map(|linear| rest(linear, &weights.parameters, coefficients))
                .collect(),
        }
    }

    /// Computes the loss on the sample opened at `position`, and checks every product on the way.
    pub fn loss(
        &self,
        position: usize,
        sample: &Sample,
        draw: &Draw,
    ) -> Result<LossSum, EvalError> {
        let projections = self.projections.as_ref();
        let projections = projections.ok_or(EvalError::Dimensions("the list of projections"))?;
        let hints = self.weights.hints.get(position);
        let hints = hints.ok_or(EvalError::Dimensions("the list of hints"))?;
        let mut checked = Checked::new(hints.sums(), self.coefficients, projections, &self.rests);
        let parameters = &self.weights.parameters;
        let loss = self
            .evaluator
            .loss(parameters, &mut checked, sample, draw)?;
        checked.finish()?;
        Ok(loss)
    }
}
