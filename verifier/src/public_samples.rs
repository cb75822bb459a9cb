//! The public samples: their file, and the loss of weights on them.
//!
//! The file holds [`Sample`]s back to back. One sample at a time is decoded.

use zk0_circuits::model::draw::draw;
use zk0_circuits::model::eval::{EvalError, Evaluator, Overflow};
use zk0_circuits::model::sample::{Sample, SampleError};
use zk0_circuits::model::spec::Dims;
use zk0_circuits::model::weights::QuantisedWeights;
use zk0_circuits::{Digest, EvalSpec};
use zk0_protocol::blob::blob_digest;
use zk0_protocol::entries::round_result::PublicLoss;
use zk0_protocol::rules::closing::public_samples::PublicSamples;

/// Why a file does not hold the public samples.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PublicSamplesError {
    /// Another file.
    #[error("the rules name the public samples {expected}, but this file has SHA-256 {actual}")]
    OtherFile {
        /// The digest in the rules.
        expected: Digest,
        /// The file's digest.
        actual: Digest,
    },
    /// A sample cannot be read.
    #[error("public sample {number}: {error}; were the samples made for the network's policy?")]
    Sample {
        /// Its number, from 0.
        number: u32,
        /// What is wrong.
        error: SampleError,
    },
    /// The file ends too early.
    #[error("the file of public samples ends after sample {found}; the rules count {expected}")]
    TooFew {
        /// Samples found.
        found: u32,
        /// Samples by the rules.
        expected: u32,
    },
    /// The file goes on after the last sample.
    #[error("the file of public samples has {bytes} bytes after the {expected} samples that the rules count")]
    TooMany {
        /// Bytes after the last sample.
        bytes: usize,
        /// Samples by the rules.
        expected: u32,
    },
    /// The evaluation fails, not by an overflow.
    #[error("the public samples cannot be evaluated: {0}")]
    Evaluation(EvalError),
}

/// The rules' file of public samples, read once from beginning to end.
#[derive(Clone, Debug)]
pub struct PublicSampleFile<'a> {
    rule: PublicSamples,
    bytes: &'a [u8],
    elements: u64,
}

impl<'a> PublicSampleFile<'a> {
    /// Reads the file that `rule` names, of samples at the dimensions of `spec`.
    ///
    /// # Errors
    /// Another file, number of samples, or dimensions.
    pub fn read(
        spec: &EvalSpec,
        rule: PublicSamples,
        bytes: &'a [u8],
    ) -> Result<Self, PublicSamplesError> {
        let actual = blob_digest(bytes);
        if actual != rule.blob {
            return Err(PublicSamplesError::OtherFile {
                expected: rule.blob,
                actual,
            });
        }
        let dims = &spec.dims;
        let (mut rest, mut elements) = (bytes, 0);
        for number in 0..rule.samples {
            if rest.is_empty() {
                return Err(PublicSamplesError::TooFew {
                    found: number,
                    expected: rule.samples,
                });
            }
            let (sample, later) = next(dims, number, rest)?;
            let counts = (0..dims.chunk as usize).filter(|frame| !sample.is_pad(*frame));
            elements += counts.count() as u64 * u64::from(dims.action_dim);
            rest = later;
        }
        if !rest.is_empty() {
            return Err(PublicSamplesError::TooMany {
                bytes: rest.len(),
                expected: rule.samples,
            });
        }
        Ok(Self {
            rule,
            bytes,
            elements,
        })
    }

    /// The elements of the loss: unpadded frames times real action dimensions, over all samples.
    pub fn elements(&self) -> u64 {
        self.elements
    }

    /// The loss of `weights` on these samples in this network. Flow times and noise are the same for all weights.
    pub fn loss(
        &self,
        evaluator: &Evaluator<'_>,
        weights: &QuantisedWeights,
        network: &Digest,
    ) -> Result<PublicLoss, PublicSamplesError> {
        let spec = evaluator.spec;
        let failed = PublicSamplesError::Evaluation;
        let seed = self.rule.seed(network);
        let (mut rest, mut sum) = (self.bytes, 0u64);
        for number in 0..self.rule.samples {
            let (sample, later) = next(&spec.dims, number, rest)?;
            rest = later;
            let mut multiply = evaluator
                .direct(weights, Overflow::Refused)
                .map_err(failed)?;
            let draw = draw(spec, &seed, number, self.rule.samples);
            match evaluator.loss(&mut multiply, &sample, &draw) {
                Ok(loss) => sum = sum.saturating_add(loss.squared_error),
                Err(overflow @ EvalError::OutOfRange { .. }) => {
                    tracing::warn!("public sample {number}: {overflow}");
                    return Ok(PublicLoss::Overflow { sample: number });
                }
                Err(other) => return Err(failed(other)),
            }
        }
        Ok(PublicLoss::SquaredError(sum))
    }
}

/// Sample `number` at the front of `bytes`, and the rest.
fn next<'b>(
    dims: &Dims,
    number: u32,
    bytes: &'b [u8],
) -> Result<(Sample, &'b [u8]), PublicSamplesError> {
    Sample::split_from(dims, bytes).map_err(|error| PublicSamplesError::Sample { number, error })
}
