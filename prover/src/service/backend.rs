//! What checks and proves claims behind the service. Tests play it, so that they need no SP1.

use crate::program::{Execution, GuestInput, GuestInputError};
use crate::prove::Proof;
use tonic::Status;

/// Why a request is refused or fails.
#[derive(Debug, thiserror::Error)]
pub enum JobError {
    /// The private input proves no claim.
    #[error(transparent)]
    Input(#[from] GuestInputError),
    /// The prover failed.
    #[error("proving failed: {0}")]
    Failed(String),
}

impl From<JobError> for Status {
    fn from(error: JobError) -> Self {
        let text = error.to_string();
        match error {
            JobError::Input(GuestInputError::Unreadable(_)) => Self::invalid_argument(text),
            JobError::Input(GuestInputError::Statement(_) | GuestInputError::NotShown(_)) => {
                Self::failed_precondition(text)
            }
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
    /// Proves it. The service calls this for one input at a time.
    async fn prove(&self, input: &GuestInput) -> Result<Proof, JobError>;
}
