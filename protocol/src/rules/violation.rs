//! The named reasons for which the state refuses an entry.

use crate::{
    entries::{codec::EntryError, refusal::Refusal},
    rules::state::Standing,
};
use zk0_circuits::NodeId;

/// Why an entry cannot follow the history so far.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RuleViolation {
    /// A node's statement that the rules refuse.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// An entry too large, or of another version.
    #[error(transparent)]
    Entry(#[from] EntryError),
    /// Time ran backwards.
    #[error("the entry's time is {time_ms} ms, the one before it has {last_ms} ms")]
    TimeBackwards { time_ms: u64, last_ms: u64 },
    /// The first entry is not a genesis.
    #[error("the first entry is not a genesis")]
    NoGenesis,
    /// A genesis that is not the first entry.
    #[error("a second genesis")]
    SecondGenesis,
    /// A genesis no network can live by.
    #[error("genesis: {0}")]
    BadGenesis(String),
    /// A node that cannot be enrolled.
    #[error("node {node} cannot be enrolled: {why}")]
    BadNode { node: NodeId, why: String },
    /// Enrolled twice.
    #[error("node {0} is already enrolled")]
    AlreadyEnrolled(NodeId),
    /// A dataset changed under an open round.
    #[error("node {node} cannot replace its dataset while round {round} is open")]
    DatasetInUse { node: NodeId, round: u64 },
    /// A round opened before the one before it closed.
    #[error("round {0} is still open")]
    RoundStillOpen(u64),
    /// A field of a round's opening or closing is not what the ledger fixes.
    #[error("round {round}: {field} is {found}, it has to be {expected}")]
    RoundField {
        round: u64,
        field: &'static str,
        found: String,
        expected: String,
    },
    /// Nothing to close.
    #[error("round {0} is not open")]
    RoundNotOpen(u64),
    /// Closed while a node could still contribute.
    #[error("round {round} cannot close {early_ms} ms before its deadline: {waiting_for}")]
    ClosedEarly {
        round: u64,
        early_ms: u64,
        waiting_for: String,
    },
    /// Refused for a reason that does not hold, or not for the one that does.
    #[error("the contribution is refused because '{given}', but {found}")]
    WrongReason { given: String, found: String },
    /// The operator enrols a node where only a vote can.
    #[error("node {0} cannot be enrolled by the operator: the rules ask for a vote")]
    EnrolmentByVote(NodeId),
    /// Two halves of a key rotation that do not fit.
    #[error("node {0}'s key cannot be rotated: the new key signed another rotation")]
    OtherTakeover(NodeId),
    /// A key that the open round knows.
    #[error("node {node} cannot change its key: it has committed an update in round {round}, which is open")]
    KeyInUse { node: NodeId, round: u64 },
    /// So many keys that whose a thing is takes long to say.
    #[error("node {node} has changed its key {limit} times: only a vote can give it another")]
    TooManyKeys { node: NodeId, limit: usize },
    /// A proposal that makes no sense.
    #[error("proposal {number}: {why}")]
    BadProposal { number: u64, why: String },
    /// Neither a governor nor a node whose credits vote.
    #[error("{0} has no vote here")]
    NoVote(NodeId),
    /// Nothing to vote on.
    #[error("proposal {0} is not open")]
    ProposalNotOpen(u64),
    /// Too late.
    #[error("a {what} on proposal {number} comes {late_ms} ms too late")]
    VoteClosed {
        number: u64,
        what: String,
        late_ms: u64,
    },
    /// A veto while the vote lasts.
    #[error("a veto on proposal {number} comes {early_ms} ms too early: vote against it, or wait for the end of the vote")]
    VetoEarly { number: u64, early_ms: u64 },
    /// A second vote.
    #[error("{voter} has voted on proposal {number} already; votes are final")]
    VotedTwice { number: u64, voter: NodeId },
    /// Settled while it can be voted on or vetoed.
    #[error("proposal {number} cannot be settled for another {early_ms} ms")]
    SettledEarly { number: u64, early_ms: u64 },
    /// Settled otherwise than it ended.
    #[error("proposal {number} is settled as '{found}', but it is {expected}")]
    OtherOutcome {
        number: u64,
        found: String,
        expected: String,
    },
    /// A round opened before what was decided took effect.
    #[error("proposal {0} has to be settled before a round opens")]
    ProposalDue(u64),
    /// A dispute that makes no sense, or its end.
    #[error("dispute about entry {entry}: {why}")]
    BadDispute { entry: u64, why: String },
    /// A round opened before a contribution was verified again.
    #[error("the dispute of entry {0} has to be decided before a round opens")]
    DisputeUndecided(u64),
    /// Deadlines beyond the end of time.
    #[error("round {0}'s deadlines do not fit in 64 bits")]
    EndOfTime(u64),
}

impl std::fmt::Display for Standing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Active => "active",
            Self::Suspended => "suspended",
            Self::Revoked => "revoked",
        })
    }
}
