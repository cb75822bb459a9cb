//! What checks and proves claims behind the service. Tests play it, so that they need no SP1.

use super::waiting::{GivenUp, WaitingClient};
use crate::program::{Execution, GuestInput, GuestInputError, HoldsRecording};
use crate::prove::Proof;
use tonic::Status;

/// Why a request is refused or fails.
#[derive(Debug, thiserror::Error)]
pub enum JobError {
    /// The private input proves no claim.
    #[error(transparent)]
    Input(#[from] GuestInputError),
    /// The private input must not leave this machine, and the prover is elsewhere.
    #[error(transparent)]
    Private(#[from] HoldsRecording),
    /// Nobody waits for the proof any more: the service stops, so that the client has to ask again.
    #[error(transparent)]
    GivenUp(#[from] GivenUp),
    /// As many claims wait as may.
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

/// What checks claims and proves them.
#[tonic::async_trait]
pub trait Backend: Send + Sync + 'static {
    /// Gets ready to prove. The service calls this once, before the first proof.
    async fn start(&self) -> Result<(), JobError>;
    /// Checks the statement and counts its cycles, in seconds.
    async fn check(&self, input: &GuestInput) -> Result<Execution, JobError>;
    /// Proves it. The service calls this for one input at a time. `execution` is what [`Self::check`] gave for it.
    async fn prove(
        &self,
        input: &GuestInput,
        execution: &Execution,
        waiting: &WaitingClient,
    ) -> Result<Proof, JobError>;
    /// Whether [`Self::prove`] gives up a proof whose client has gone. Otherwise the proof is made to the end, and kept.
    fn withdraws(&self) -> bool {
        false
    }
}
