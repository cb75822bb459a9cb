//! Why the aggregator turns a request down, and its gRPC status, with the code of the refusal and what the node does next.

use crate::round::intake::staging::StagingError;
use tonic::{Code, Status};
use zk0_ledger::blobs::BlobError;
use zk0_ledger::clock::ClockError;
use zk0_ledger::error::LedgerError;
use zk0_protocol::entries::refusal::code::RoundFile;
use zk0_protocol::entries::signed::SignatureError;
use zk0_protocol::request_head::HeadRefusal;
use zk0_protocol::rpc::federation::{turned_down::Remedy, TurnedDown};
use zk0_protocol::rules::violation::RuleViolation;
use zk0_protocol::{Refusal, RefusalCode};
use zk0_verifier::close::CloseError;
use zk0_verifier::Unreadable;

/// Milliseconds until a new try of what is not possible now.
const AFTER_MS: u64 = 2000;

/// The same for a failed aggregator, which most likely needs a restart.
const AFTER_FAILURE_MS: u64 = 15_000;

/// Why a request is turned down.
#[derive(Debug, thiserror::Error)]
pub enum RequestError {
    /// The bytes are malformed.
    #[error("{0}")]
    Malformed(String),
    /// The request's head is invalid.
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
    /// The blob is also an old round's, and is deleted right now.
    #[error("blob {0} is that of an old round, too, and was deleted just now: send it again")]
    Deleted(zk0_circuits::Digest),
    /// Only the network's operator may do this.
    #[error("only the network's operator enrols nodes, with the log's key; this enrolment is signed by {0}")]
    NotOperator(zk0_circuits::NodeId),
    /// No round can start from the final weights of this round.
    #[error("round {round} ended with the weights {blob}, but the aggregator does not have that blob any more")]
    LostWeights {
        round: u64,
        blob: zk0_circuits::Digest,
    },
    /// No round could close with the proposed public samples.
    #[error("{0}")]
    PublicSamples(String),
    /// The node asks for too much.
    #[error("{why}")]
    Busy {
        why: String,
        /// Whether there is room for it later.
        remedy: Remedy,
    },
    /// Many ask for the same at once. There is room later.
    #[error("{0}")]
    Crowded(String),
    /// The data of an upload does not begin where it has to.
    #[error("{0}")]
    OtherPlace(String),
    /// The request took too long.
    #[error("{0}")]
    TimedOut(String),
    /// Recorded, but not published: no cosigned checkpoint covers it.
    #[error("{0}")]
    NotPublished(String),
    /// The disk has no room. Only the log tells more.
    #[error("what was sent cannot be kept: {0}")]
    NoRoom(String),
    /// The store of the blobs failed, so nothing is recorded. Only the log tells more.
    #[error("{0}")]
    BlobStore(String),
    /// The store does not continue this ledger, so nothing more is recorded. Only the log tells why.
    #[error("{0}")]
    StoredEntries(Box<LedgerError>),
    /// The aggregator's clock is wrong.
    #[error(transparent)]
    Clock(#[from] ClockError),
    /// The aggregator failed. Only the log tells why, because that names paths.
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

impl From<RefusalCode> for RequestError {
    fn from(code: RefusalCode) -> Self {
        Self::Refused(code.into())
    }
}

impl From<SignatureError> for RequestError {
    fn from(error: SignatureError) -> Self {
        Self::Refused(RefusalCode::Signature.because(error))
    }
}

impl From<LedgerError> for RequestError {
    fn from(error: LedgerError) -> Self {
        match error {
            LedgerError::Rule(violation) => violation.into(),
            LedgerError::Clock(error) => error.into(),
            other if other.is_of_stored_entries() => Self::StoredEntries(Box::new(other)),
            other => Self::Internal(other.to_string()),
        }
    }
}

impl From<BlobError> for RequestError {
    fn from(error: BlobError) -> Self {
        (&error).into()
    }
}

impl From<&BlobError> for RequestError {
    fn from(error: &BlobError) -> Self {
        let told = error.to_string();
        match error {
            BlobError::Store(_) => Self::BlobStore(told),
            full if full.is_full() => Self::NoRoom(told),
            _ => Self::Internal(told),
        }
    }
}

impl From<Unreadable<BlobError>> for RequestError {
    fn from(unreadable: Unreadable<BlobError>) -> Self {
        let reported = unreadable.to_string();
        match unreadable.error {
            // A blob from the store is written to the ledger's folder, which may be full.
            error if matches!(error, BlobError::Store(_)) || error.is_full() => error.into(),
            _ => Self::Internal(reported),
        }
    }
}

impl From<StagingError> for RequestError {
    fn from(error: StagingError) -> Self {
        match error {
            StagingError::Quota(_) => Self::Busy {
                why: error.to_string(),
                remedy: Remedy::NextRound,
            },
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
    /// Why an upload is not stored, where the sender caused that.
    pub fn upload(error: BlobError) -> Self {
        match error {
            BlobError::TooLarge { size, limit } => {
                let file = RoundFile::Update;
                Self::Refused(RefusalCode::TooLarge { file, size, limit }.into())
            }
            BlobError::Incomplete { held, size } => {
                Self::Malformed(format!("the upload ended after {held} of {size} bytes"))
            }
            BlobError::WrongDigest { expected, actual } => {
                Self::Refused(RefusalCode::UpdateDigest { expected, actual }.into())
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
                // Another head counts. A clock that has jumped is set right soon.
                HeadRefusal::Run
                | HeadRefusal::Time { .. }
                // The window forgets heads within minutes.
                | HeadRefusal::TooMany { .. }
                | HeadRefusal::Forgotten { .. } => Code::Unavailable,
                HeadRefusal::Replayed => Code::AlreadyExists,
                _ => Code::Unauthenticated,
            },
            Self::Violation(_) | Self::LostWeights { .. } | Self::PublicSamples(_) => {
                Code::FailedPrecondition
            }
            Self::HeldBack(_) | Self::NotOperator(_) => Code::PermissionDenied,
            Self::UnknownBlob(_) | Self::NotKept(_) => Code::NotFound,
            Self::Busy { .. } => Code::ResourceExhausted,
            Self::OtherPlace(_) => Code::Aborted,
            Self::TimedOut(_) => Code::DeadlineExceeded,
            Self::Crowded(_)
            | Self::Deleted(_)
            | Self::NotPublished(_)
            | Self::NoRoom(_)
            | Self::BlobStore(_)
            | Self::Clock(_) => Code::Unavailable,
            Self::StoredEntries(_) | Self::Internal(_) => Code::Internal,
            Self::Refused(refusal) => match refusal.code {
                RefusalCode::TooLarge { .. } => Code::ResourceExhausted,
                RefusalCode::Signature => Code::Unauthenticated,
                RefusalCode::NotEnrolled(_)
                | RefusalCode::NotActive { .. }
                | RefusalCode::NotInvited { .. }
                | RefusalCode::Paused { .. } => Code::PermissionDenied,
                RefusalCode::RoundFull { .. } => Code::OutOfRange,
                RefusalCode::Duplicate { .. } | RefusalCode::CopiedUpdate { .. } => {
                    Code::AlreadyExists
                }
                RefusalCode::WrongNetwork { .. }
                | RefusalCode::WrongRound { .. }
                | RefusalCode::Late { .. }
                | RefusalCode::NotCommitted(_)
                | RefusalCode::MissingUpdate(_)
                | RefusalCode::CommitmentsClosed { .. }
                | RefusalCode::NoRandomness { .. }
                | RefusalCode::NoVerifier => Code::FailedPrecondition,
                _ => Code::InvalidArgument,
            },
        }
    }

    /// What the sender does next.
    fn remedy(&self) -> Remedy {
        match self {
            // Another head, or the same later, counts. A clock that has jumped is set right soon.
            Self::Head(
                HeadRefusal::Run
                | HeadRefusal::Time { .. }
                | HeadRefusal::TooMany { .. }
                | HeadRefusal::Forgotten { .. },
            )
            | Self::OtherPlace(_)
            | Self::TimedOut(_)
            | Self::Crowded(_)
            | Self::Deleted(_)
            | Self::NotPublished(_)
            | Self::NoRoom(_)
            | Self::BlobStore(_)
            | Self::StoredEntries(_)
            | Self::Clock(_)
            | Self::Internal(_) => Remedy::AskAgain,
            Self::Busy { remedy, .. } => *remedy,
            // The round goes on without the node, or has its contribution.
            Self::Head(HeadRefusal::Replayed) => Remedy::NextRound,
            Self::Refused(refusal) => match refusal.code {
                RefusalCode::RoundFull { .. }
                | RefusalCode::Duplicate { .. }
                | RefusalCode::CopiedUpdate { .. }
                | RefusalCode::WrongRound { .. }
                | RefusalCode::Late { .. }
                | RefusalCode::NotCommitted(_)
                | RefusalCode::CommitmentsClosed { .. }
                | RefusalCode::NoRandomness { .. } => Remedy::NextRound,
                _ => Remedy::Never,
            },
            _ => Remedy::Never,
        }
    }

    fn details(&self) -> TurnedDown {
        let remedy = self.remedy();
        TurnedDown {
            code: match self {
                Self::Refused(refusal) => refusal.code.number().into(),
                _ => 0,
            },
            remedy: remedy.into(),
            after_ms: match self {
                Self::StoredEntries(_) | Self::Internal(_) => AFTER_FAILURE_MS,
                _ if remedy == Remedy::AskAgain => AFTER_MS,
                _ => 0,
            },
        }
    }
}

impl From<RequestError> for Status {
    fn from(error: RequestError) -> Self {
        let told: String = match &error {
            RequestError::NoRoom(_) => {
                tracing::error!("{error}");
                "the aggregator's disk is full, so it keeps nothing until there is room: ask again".into()
            }
            RequestError::BlobStore(_) => {
                tracing::error!("{error}");
                "the aggregator's blob store does not answer as it should, and nothing was recorded: ask again".into()
            }
            // The log has more, once.
            RequestError::Clock(_) => {
                "the aggregator's clock is wrong, so it records nothing until its operator has set it: ask again".into()
            }
            RequestError::StoredEntries(_) | RequestError::Internal(_) => {
                tracing::error!(cause = %error, "request failed");
                "the aggregator failed; its log states why".into()
            }
            other => other.to_string(),
        };
        error.details().status(error.code(), told)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zk0_circuits::NodeId;

    /// A node ends where it is refused for good, and not where it has to ask again or wait.
    #[test]
    fn what_passes_has_a_remedy() {
        let told = |error: RequestError| {
            let status = Status::from(error);
            let details = TurnedDown::of(&status);
            (details.code, details.remedy(), details.after_ms)
        };
        let (round, limit, sender) = (3, 1300, NodeId([1; 32]));
        let full = RefusalCode::RoundFull { round, limit };
        let refused = |code: RefusalCode| told(RequestError::Refused(code.into()));
        assert_eq!(refused(full), (27, Remedy::NextRound, 0));
        assert_eq!(refused(RefusalCode::InvalidProof), (19, Remedy::Never, 0));
        let limit = 4;
        for passes in [
            HeadRefusal::TooMany { sender, limit },
            HeadRefusal::Forgotten { sender_ms: 1 },
        ] {
            let again = (0, Remedy::AskAgain, AFTER_MS);
            assert_eq!(told(RequestError::Head(passes)), again);
        }
        // A failure of the aggregator ends no node: there is time for a restart.
        let failed = told(RequestError::Internal("no disk".into()));
        assert_eq!(failed, (0, Remedy::AskAgain, AFTER_FAILURE_MS));
        let quota = RequestError::from(StagingError::Quota(sender));
        assert_eq!(told(quota), (0, Remedy::NextRound, 0));
    }
}
