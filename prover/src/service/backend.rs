//! Checks and proves claims behind the service. Tests replace it, without SP1.

use super::waiting::{GivenUp, WaitingClient};
use crate::program::{Execution, GuestInput, GuestInputError, HoldsRecording};
use crate::prove::Proof;
use tonic::Status;

/// A request's refusal or failure.
#[derive(Debug, thiserror::Error)]
pub enum JobError {
    /// The private input proves no claim.
    #[error(transparent)]
    Input(#[from] GuestInputError),
    /// The private input must stay on this machine, and the prover is elsewhere.
    #[error(transparent)]
    Private(#[from] HoldsRecording),
    /// Waiting ended, for example because the service stops. The client has to ask again.
    #[error(transparent)]
    GivenUp(#[from] GivenUp),
    /// The queue has no place.
    #[error("the prover's queue is full until a proof is done")]
    QueueFull,
    /// The prover failed.
    #[error("proving failed: {0}")]
    Failed(String),
}

impl JobError {
    pub(super) fn failed(error: impl ToString) -> Self {
        Self::Failed(error.to_string())
    }
}

impl From<JobError> for Status {
    fn from(error: JobError) -> Self {
        let text = error.to_string();
        match error {
            JobError::Input(GuestInputError::Unreadable(_)) => Self::invalid_argument(text),
            JobError::Input(GuestInputError::Statement(_) | GuestInputError::NotShown(_))
            | JobError::Private(_) => Self::failed_precondition(text),
            JobError::GivenUp(_) => Self::unavailable(text),
            JobError::QueueFull => Self::resource_exhausted(text),
            JobError::Failed(_) => Self::internal(text),
        }
    }
}

/// Checks and proves claims.
#[tonic::async_trait]
pub trait Backend: Send + Sync + 'static {
    /// Prepares for proofs. The service calls this once, first.
    async fn start(&self) -> Result<(), JobError>;
    /// Checks the statement and counts its cycles, in seconds.
    async fn check(&self, input: &GuestInput) -> Result<Execution, JobError>;
    /// Proves it. The service calls this for one input at a time, with the `execution` that [`Self::check`] gave.
    async fn prove(
        &self,
        input: &GuestInput,
        execution: &Execution,
        waiting: &WaitingClient,
    ) -> Result<Proof, JobError>;
    /// Whether [`Self::prove`] gives up a proof whose client has gone. Otherwise the proof is finished and kept.
    fn withdraws(&self) -> bool {
        false
    }
}
