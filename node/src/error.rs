//! Why a node cannot go on.

use crate::client_error::NodeError;
use std::{io, path::PathBuf};
use zk0_circuits::claim::{challenge::DrawError, statement_error::StatementError};
use zk0_prover::service::ClientError;
use zk0_smolvla::frames::prefix_cache::CacheError;

/// Why a node cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum ParticipantError {
    /// The recording.
    #[error("the recording: {0}")]
    Dataset(#[from] zk0_lerobot::dataset::DatasetError),
    /// The recording, or how it fits the policy.
    #[error("the recording: {0}")]
    Prepare(#[from] zk0_smolvla::frames::recording::PrepareError),
    /// The cache of prepared samples.
    #[error(transparent)]
    Cache(#[from] CacheError),
    /// The policy, its weights, or training.
    #[error("the policy: {0}")]
    Policy(#[from] zk0_smolvla::PolicyError),
    /// Values outside the ranges that the round's specification can hold.
    #[error("fixed point: {0}")]
    Quantise(#[from] zk0_circuits::model::quantise::QuantiseError),
    /// The network's evaluation specification.
    #[error("the network's evaluation specification: {0}")]
    Spec(#[from] zk0_circuits::model::spec::SpecError),
    /// The network was founded with another guest program than this version of zk0 has.
    #[error("the network proves with another program than this version of zk0 has: join with the version it was founded with")]
    OtherProgram,
    /// The policy and the evaluation specification are not of the same dimensions.
    #[error("the network's policy and its evaluation specification differ in dimensions; its founder has to mend that")]
    Dimensions,
    /// The challenge cannot be drawn.
    #[error("the challenge: {0}")]
    Draw(#[from] DrawError),
    /// The claim does not hold: the update is not better by enough on the samples drawn.
    #[error("the update cannot be proven: {0}")]
    Statement(#[from] StatementError),
    /// The aggregator.
    #[error("the aggregator: {0}")]
    Node(#[from] NodeError),
    /// The proving service.
    #[error("the proving service: {0}")]
    Prover(#[from] ClientError),
    /// A file of the node's own.
    #[error("{path}: {error}")]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// A file of the node's own that does not hold what it should.
    #[error("{path} is not what this node wrote there: {why}; move it away to start anew")]
    BrokenFile {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// The machine.
    #[error("the system gives no random bytes: {0}")]
    Random(getrandom::Error),
}
