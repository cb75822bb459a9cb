//! Why the aggregator turns a request down, and the gRPC status that says so.

use crate::round::intake::staging::StagingError;
use tonic::{Code, Status};
use zk0_ledger::blobs::BlobError;
use zk0_ledger::clock::ClockError;
use zk0_ledger::error::LedgerError;
use zk0_protocol::entries::signed::SignatureError;
use zk0_protocol::request_head::HeadRefusal;
use zk0_protocol::rules::violation::RuleViolation;
use zk0_protocol::Refusal;
use zk0_verifier::close::CloseError;
use zk0_verifier::Unreadable;

/// Why a request is turned down.
#[derive(Debug, thiserror::Error)]
pub enum RequestError {
    /// The bytes are not what they should be.
    #[error("{0}")]
    Malformed(String),
    /// The request's head does not count.
    #[error(transparent)]
    Head(#[from] HeadRefusal),
    /// The rules refuse a contribution.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The rules do not allow this entry.
    #[error(transparent)]
    Violation(RuleViolation),
    /// The blob stays private until its round closes.
    #[error("blob {0} is private until its round closes")]
    HeldBack(zk0_circuits::Digest),
    /// No entry names the blob.
    #[error("the ledger names no blob {0}")]
    UnknownBlob(zk0_circuits::Digest),
    /// An entry names the blob, and it is not here.
    #[error("this aggregator does not have blob {0} any more: it was pruned, or is lost")]
    NotKept(zk0_circuits::Digest),
    /// Only the network's operator may do this.
    #[error("only the network's operator enrols nodes, with the log's key; this enrolment is signed by {0}")]
    NotOperator(zk0_circuits::NodeId),
    /// No round can start from the weights that this round ended with.
    #[error("round {round} ended with the weights {blob}, but the aggregator does not have that blob any more")]
    LostWeights {
        round: u64,
        blob: zk0_circuits::Digest,
    },
    /// No round could be closed with the public samples that are proposed.
    #[error("{0}")]
    PublicSamples(String),
    /// The node asks for too much at once.
    #[error("{0}")]
    Busy(String),
    /// Many ask for the same at once. There is room for this request later.
    #[error("{0}")]
    Crowded(String),
    /// The data of an upload does not begin where it has to.
    #[error("{0}")]
    OtherPlace(String),
    /// The request took too long.
    #[error("{0}")]
    TimedOut(String),
    /// The entry is recorded, but not published: the witnesses have not cosigned a checkpoint that covers it.
    #[error("{0}")]
    NotPublished(String),
    /// The disk has no room for what was sent. Whoever asked is not told more: the log says it.
    #[error("what was sent cannot be kept: {0}")]
    NoRoom(BlobError),
    /// The store of the blobs failed, so nothing is recorded. Whoever asked is not told more: the log says it.
    #[error("{0}")]
    BlobStore(BlobError),
    /// The aggregator's clock is wrong.
    #[error(transparent)]
    Clock(#[from] ClockError),
    /// The aggregator failed. Whoever asked is not told why, because that names paths: the log says it.
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
            LedgerError::Clock(error) => error.into(),
            other => Self::Internal(other.to_string()),
        }
    }
}

impl From<BlobError> for RequestError {
    fn from(error: BlobError) -> Self {
        match error {
            failed @ BlobError::Store(_) => Self::BlobStore(failed),
            full if full.is_full() => Self::NoRoom(full),
            other => Self::Internal(other.to_string()),
        }
    }
}

impl From<Unreadable<BlobError>> for RequestError {
    fn from(unreadable: Unreadable<BlobError>) -> Self {
        let said = unreadable.to_string();
        match unreadable.error {
            // What is read from the store is written to the ledger's folder, so there may be no room for it.
            error if matches!(error, BlobError::Store(_)) || error.is_full() => error.into(),
            _ => Self::Internal(said),
        }
    }
}

impl From<StagingError> for RequestError {
    fn from(error: StagingError) -> Self {
        match error {
            StagingError::Quota(_) => Self::Busy(error.to_string()),
            StagingError::OtherPlace { .. } => Self::OtherPlace(error.to_string()),
            StagingError::Blob(error) => Self::upload(error),
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
    /// Why an uploaded blob is not stored. The sender caused that, and not the aggregator's disk.
    pub fn upload(error: BlobError) -> Self {
        match error {
            BlobError::TooLarge { size, limit } => Self::Refused(Refusal::TooLarge {
                what: "the upload".into(),
                size,
                limit,
            }),
            BlobError::Incomplete { held, size } => {
                Self::Malformed(format!("the upload ended after {held} of {size} bytes"))
            }
            BlobError::WrongDigest { expected, actual } => {
                Self::Refused(Refusal::UpdateDigest { expected, actual })
            }
            unsent @ (BlobError::NotSent | BlobError::OtherSize { .. }) => {
                Self::Malformed(unsent.to_string())
            }
            other => other.into(),
        }
    }

    fn code(&self) -> Code {
        match self {
            Self::Malformed(_) => Code::InvalidArgument,
            Self::Head(refusal) => match refusal {
                // A client that asks again does better, with another head. A clock may have jumped, and is set right soon.
                HeadRefusal::Run
                | HeadRefusal::Time { .. }
                // The window forgets heads within minutes.
                | HeadRefusal::TooMany { .. }
                | HeadRefusal::NoRoom { .. }
                | HeadRefusal::Forgotten { .. } => Code::Unavailable,
                HeadRefusal::Replayed => Code::AlreadyExists,
                _ => Code::Unauthenticated,
            },
            Self::Violation(_) | Self::LostWeights { .. } | Self::PublicSamples(_) => {
                Code::FailedPrecondition
            }
            Self::HeldBack(_) | Self::NotOperator(_) => Code::PermissionDenied,
            Self::UnknownBlob(_) | Self::NotKept(_) => Code::NotFound,
            Self::Busy(_) => Code::ResourceExhausted,
            Self::OtherPlace(_) => Code::Aborted,
            Self::TimedOut(_) => Code::DeadlineExceeded,
            Self::Crowded(_)
            | Self::NotPublished(_)
            | Self::NoRoom(_)
            | Self::BlobStore(_)
            | Self::Clock(_) => Code::Unavailable,
            Self::Internal(_) => Code::Internal,
            Self::Refused(refusal) => match refusal {
                Refusal::TooLarge { .. } => Code::ResourceExhausted,
                Refusal::Signature(_) => Code::Unauthenticated,
                Refusal::NotEnrolled(_)
                | Refusal::NotActive { .. }
                | Refusal::NotInvited { .. }
                | Refusal::Paused { .. } => Code::PermissionDenied,
                // The node knows by this code that it has to wait for the next round.
                Refusal::RoundFull { .. } => Code::OutOfRange,
                Refusal::Duplicate { .. } | Refusal::CopiedUpdate { .. } => Code::AlreadyExists,
                Refusal::WrongNetwork { .. }
                | Refusal::WrongRound { .. }
                | Refusal::Late { .. }
                | Refusal::NotCommitted(_)
                | Refusal::MissingUpdate(_)
                | Refusal::CommitmentsClosed { .. }
                | Refusal::NoRandomness { .. }
                | Refusal::NoVerifier { .. } => Code::FailedPrecondition,
                _ => Code::InvalidArgument,
            },
        }
    }
}

impl From<RequestError> for Status {
    fn from(error: RequestError) -> Self {
        if let RequestError::NoRoom(_) = &error {
            tracing::error!("{error}");
            return Self::unavailable(
                "the aggregator's disk is full, so it keeps nothing until there is room: ask again",
            );
        }
        if let RequestError::BlobStore(_) = &error {
            tracing::error!("{error}");
            return Self::unavailable(
                "the aggregator's blob store does not answer as it should, and nothing was recorded: ask again",
            );
        }
        if let RequestError::Clock(_) = &error {
            // The log says more, once.
            return Self::unavailable(
                "the aggregator's clock is wrong, so it records nothing until its operator has set it: ask again",
            );
        }
        if let RequestError::Internal(cause) = &error {
            tracing::error!(%cause, "request failed");
            return Self::internal("the aggregator failed; its log says why");
        }
        Self::new(error.code(), error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zk0_circuits::NodeId;

    /// A node ends where it is refused, and not where it is told to ask again or to wait for the next round.
    #[test]
    fn what_passes_has_a_code_of_its_own() {
        let code = |error: RequestError| Status::from(error).code();
        let (round, limit, sender) = (3, 1300, NodeId([1; 32]));
        let full = RequestError::Refused(Refusal::RoundFull { round, limit });
        assert_eq!(code(full), Code::OutOfRange);
        let limit = 4;
        for passes in [
            HeadRefusal::TooMany { sender, limit },
            HeadRefusal::NoRoom { limit },
            HeadRefusal::Forgotten { sender_ms: 1 },
        ] {
            assert_eq!(code(RequestError::Head(passes)), Code::Unavailable);
        }
    }
}
