//! Evaluates a round's result before it is taken: its loss beside the base's, on the public samples, by the proofs' fixed-point
//! evaluation, which gives every machine the same numbers.

use crate::combine::strategy::Global;
use crate::contribution_blobs::{read, Unreadable};
use crate::public_samples::{PublicSampleFile, PublicSamplesError};
use crate::update::Evaluation;
use std::fmt::Display;
use zk0_circuits::model::eval::Evaluator;
use zk0_circuits::model::spec::SpecError;
use zk0_circuits::{Digest, WeightsDigest};
use zk0_protocol::entries::round_result::EvaluatedResult;
use zk0_protocol::rules::closing::public_samples::PublicSamples;
use zk0_protocol::rules::named_blobs::BlobKind;
use zk0_protocol::rules::state::State;
use zk0_protocol::Refusal;

/// The blobs for evaluating a round's result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResultFiles {
    /// The round's base weights.
    pub base: Vec<u8>,
    /// The public samples.
    pub samples: Vec<u8>,
}

/// Why a round's result cannot be evaluated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ResultError {
    /// The rules require an evaluation, but its files were not given.
    #[error("the rules ask to evaluate the round's result on the public samples {0}; the base and these samples were not given")]
    NotGiven(Digest),
    /// The samples cannot be used.
    #[error(transparent)]
    Samples(#[from] PublicSamplesError),
    /// The weights cannot be read.
    #[error("{0}")]
    Weights(#[from] Refusal),
    /// The evaluation's specification is not valid.
    #[error(transparent)]
    Spec(#[from] SpecError),
}

impl ResultFiles {
    /// Reads the files for closing the open round; `None` without contributions or public samples.
    pub fn read<E: Display>(
        state: &State,
        get: impl Fn(&Digest, u64) -> Result<Vec<u8>, E>,
    ) -> Result<Option<Self>, Unreadable<E>> {
        let (Some(round), Some(rule)) = (state.round(), wanted(state)) else {
            return Ok(None);
        };
        let (rules, base) = (state.rules(), round.opened.base.blob);
        Ok(Some(Self {
            base: read(BlobKind::Weights, &base, rules, &get)?,
            samples: read(BlobKind::PublicSamples, &rule.blob, rules, &get)?,
        }))
    }
}

/// The samples for evaluating the open round's result.
fn wanted(state: &State) -> Option<PublicSamples> {
    let samples = state.rules().public_samples;
    samples.filter(|_| !state.contributors().is_empty())
}

/// Evaluates the open round's result, beside its `base`; `None` if the rules require no evaluation.
pub fn evaluate(
    state: &State,
    base: &WeightsDigest,
    result: &Global,
    files: Option<&ResultFiles>,
) -> Result<Option<EvaluatedResult>, ResultError> {
    let Some(rule) = wanted(state) else {
        return Ok(None);
    };
    let files = files.ok_or(ResultError::NotGiven(rule.blob))?;
    let evaluation = Evaluation::of(state)?;
    let samples = PublicSampleFile::read(evaluation.format().spec(), rule, &files.samples)?;
    let evaluator = Evaluator::new(evaluation.format().spec())?;
    let loss = |file: &[u8], digest: &WeightsDigest| -> Result<_, ResultError> {
        let weights = evaluation.check_update(file, digest)?;
        Ok(samples.loss(&evaluator, &weights, state.network())?)
    };
    let (base, loss) = (
        loss(&files.base, base)?,
        loss(&result.file, &result.digest)?,
    );
    Ok(Some(EvaluatedResult {
        weights: result.digest,
        elements: samples.elements(),
        outcome: rule.outcome(&base, &loss),
        base,
        result: loss,
    }))
}
