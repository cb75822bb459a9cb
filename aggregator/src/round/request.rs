//! Why the aggregator turns a request down, and the gRPC status that says so.

use crate::round::staging::StagingError;
use tonic::{Code, Status};
use zk0_ledger::{blobs::BlobError, error::LedgerError};
use zk0_protocol::{entries::signed::SignatureError, rules::violation::RuleViolation, Refusal};
use zk0_verifier::close::CloseError;

/// Why a request is turned down.
#[derive(Debug, thiserror::Error)]
pub enum RequestError {
    /// Bytes that are not what they should be.
    #[error("{0}")]
    Malformed(String),
    /// Not by the rules.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// Not by the rules.
    #[error(transparent)]
    Violation(RuleViolation),
    /// A blob that is not for everyone yet.
    #[error("blob {0} is private until its round closes")]
    HeldBack(zk0_circuits::Digest),
    /// A blob nobody knows.
    #[error("the ledger names no blob {0}")]
    UnknownBlob(zk0_circuits::Digest),
    /// Too much at once.
    #[error("{0}")]
    Busy(String),
    /// Took too long.
    #[error("{0}")]
    TimedOut(String),
    /// Recorded, but not yet published: the witnesses have not cosigned a checkpoint that covers it.
    #[error("{0}")]
    NotPublished(String),
    /// Our own trouble.
    #[error("{0}")]
    Internal(String),
}

impl From<RuleViolation> for RequestError {
    fn from(violation: RuleViolation) -> Self {
        match violation {
            RuleViolation::Refused(refusal) => Self::Refused(refusal),
            other => Self::Violation(other),
        }
    }
}

impl From<SignatureError> for RequestError {
    fn from(error: SignatureError) -> Self {
        Self::Refused(Refusal::Signature(error.to_string()))
    }
}

impl From<LedgerError> for RequestError {
    fn from(error: LedgerError) -> Self {
        match error {
            LedgerError::Rule(violation) => violation.into(),
            other => Self::Internal(other.to_string()),
        }
    }
}

impl From<BlobError> for RequestError {
    fn from(error: BlobError) -> Self {
        Self::Internal(error.to_string())
    }
}

impl From<StagingError> for RequestError {
    fn from(error: StagingError) -> Self {
        match error {
            StagingError::Quota(_) => Self::Busy(error.to_string()),
            StagingError::Blob(error) => error.into(),
            StagingError::Io { .. } => Self::Internal(error.to_string()),
        }
    }
}

impl From<CloseError> for RequestError {
    fn from(error: CloseError) -> Self {
        Self::Internal(error.to_string())
    }
}

impl RequestError {
    /// Why an uploaded blob is not stored: unlike a blob that we cannot read, that is the sender's doing.
    pub fn upload(error: BlobError) -> Self {
        match error {
            BlobError::TooLarge { size, limit } => Self::Refused(Refusal::TooLarge {
                what: "the upload".into(),
                size,
                limit,
            }),
            BlobError::WrongDigest { expected, actual } => {
                Self::Refused(Refusal::UpdateDigest { expected, actual })
            }
            other => other.into(),
        }
    }

    fn code(&self) -> Code {
        match self {
            Self::Malformed(_) => Code::InvalidArgument,
            Self::Violation(_) => Code::FailedPrecondition,
            Self::HeldBack(_) => Code::PermissionDenied,
            Self::UnknownBlob(_) => Code::NotFound,
            Self::Busy(_) => Code::ResourceExhausted,
            Self::TimedOut(_) => Code::DeadlineExceeded,
            Self::NotPublished(_) => Code::Unavailable,
            Self::Internal(_) => Code::Internal,
            Self::Refused(refusal) => match refusal {
                Refusal::TooLarge { .. } => Code::ResourceExhausted,
                Refusal::Signature(_) => Code::Unauthenticated,
                Refusal::NotEnrolled(_)
                | Refusal::NotActive { .. }
                | Refusal::NotInvited { .. } => Code::PermissionDenied,
                Refusal::Duplicate { .. } | Refusal::CopiedUpdate { .. } => Code::AlreadyExists,
                Refusal::WrongNetwork { .. }
                | Refusal::WrongRound { .. }
                | Refusal::Late { .. }
                | Refusal::NotCommitted(_)
                | Refusal::MissingUpdate(_) => Code::FailedPrecondition,
                _ => Code::InvalidArgument,
            },
        }
    }
}

impl From<RequestError> for Status {
    fn from(error: RequestError) -> Self {
        if let RequestError::Internal(cause) = &error {
            // Paths and the like are for the operator, not for whoever asked.
            tracing::error!(%cause, "request failed");
            return Self::internal("the aggregator failed; its log says why");
        }
        Self::new(error.code(), error.to_string())
    }
}
