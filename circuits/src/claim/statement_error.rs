//! Why the guest proves no claim: one variant for each check of the statement.

use crate::claim::challenge::DrawError;
use crate::claim::t_test::TTest;
use crate::claim::terms::Model;
use crate::model::site::EvalError;
use crate::model::spec::SpecError;
use crate::vm::digest::Digest;

/// The check that failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StatementError {
    /// The specification is not valid.
    #[error(transparent)]
    Spec(#[from] SpecError),
    /// The specification is not the one that the terms name.
    #[error("the terms name the evaluation specification with digest {claimed}, but the digest of the one given is {given}")]
    Evaluation {
        /// Digest in the terms.
        claimed: Digest,
        /// Digest of the specification in the header.
        given: Digest,
    },
    /// The samples cannot be drawn.
    #[error(transparent)]
    Draw(#[from] DrawError),
    /// The number of opened samples is not the claimed one.
    #[error("the claim evaluates {claimed} samples, but the private input opens {opened}")]
    Openings {
        /// Samples that the claim evaluates.
        claimed: u32,
        /// Samples opened.
        opened: usize,
    },
    /// An opened sample is not the one that the challenge draws.
    #[error("opening {position} is of sample {found}, but the challenge draws sample {drawn}")]
    Index {
        /// Which opening.
        position: usize,
        /// Index opened.
        found: u64,
        /// Index drawn.
        drawn: u64,
    },
    /// The committed dataset has another sample at that index.
    #[error("sample {index} is not the one committed: its path does not lead to the dataset root")]
    NotCommitted {
        /// Index of the sample.
        index: u64,
    },
    /// The salt is not the dataset's.
    #[error("the salt is not the one committed with the dataset")]
    Salt,
    /// An evaluation failed.
    #[error("evaluating the {model} weights on sample {index}: {error}")]
    Eval {
        /// Which weights.
        model: Model,
        /// Index of the sample.
        index: u64,
        /// Why.
        error: EvalError,
    },
    /// The evaluated weights are not those that the terms name.
    #[error("the digest of the {0} weights is not the one in the terms")]
    Weights(Model),
    /// The test does not show that the loss is lower.
    #[error("the sum of squared errors went from {before} to {after} on {samples} samples, which does not show {test}: train longer, or evaluate more samples")]
    NoImprovement {
        /// Sum under the base weights.
        before: u64,
        /// Sum under the update.
        after: u64,
        /// Number of samples.
        samples: usize,
        /// The test that the improvement does not pass.
        test: TTest,
    },
}
