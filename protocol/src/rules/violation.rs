//! Why the state refuses an entry.

use crate::challenge::drawing::RandomnessError;
use crate::entries::codec::EntryError;
use crate::entries::member::Standing;
use crate::entries::refusal::code::RefusalCode;
use crate::entries::refusal::Refusal;
use zk0_circuits::{Digest, NodeId};

/// Why an entry cannot come next.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RuleViolation {
    /// The rules refuse a node's statement.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The entry is too large or of another version.
    #[error(transparent)]
    Entry(#[from] EntryError),
    /// The entry is older than the last.
    #[error("the entry's time is {time_ms} ms, but the entry before it has {last_ms} ms")]
    TimeBackwards { time_ms: u64, last_ms: u64 },
    /// The first entry is not a genesis.
    #[error("the first entry is not a genesis")]
    NoGenesis,
    /// A second genesis.
    #[error("this is a second genesis; a log has one, its first entry")]
    SecondGenesis,
    /// The genesis has an unusable value.
    #[error("genesis: {0}")]
    BadGenesis(String),
    /// The node cannot be enrolled.
    #[error("node {node} cannot be enrolled: {why}")]
    BadNode { node: NodeId, why: String },
    /// The key belongs or belonged to a node. The text is data of the ledger (see [`crate::entries::proposal::Outcome`]).
    #[error("node {0} is already enrolled")]
    AlreadyEnrolled(NodeId),
    /// The last round is not closed.
    #[error("round {0} is still open")]
    RoundStillOpen(u64),
    /// A field of a round's opening or closing is not the ledger's.
    #[error("round {round}: {field} is {found}, but it has to be {expected}")]
    RoundField {
        round: u64,
        field: &'static str,
        found: String,
        expected: String,
    },
    /// No such round is open.
    #[error("round {0} is not open")]
    RoundNotOpen(u64),
    /// A node can still contribute to the round.
    #[error("round {round} cannot close yet: {waiting_for}")]
    ClosedEarly { round: u64, waiting_for: String },
    /// A node can still commit.
    #[error("the commitments of round {round} cannot close {early_ms} ms before their deadline: node {node} may still commit")]
    CommitmentsOpen {
        round: u64,
        early_ms: u64,
        node: NodeId,
    },
    /// The round's commitments are closed already, or its randomness is drawn.
    #[error("{what} of round {round} {done} already")]
    Again {
        round: u64,
        what: &'static str,
        done: &'static str,
    },
    /// The lost file is not of an accepted contribution.
    #[error(
        "round {round} has accepted no contribution of node {node} of which a file could be lost"
    )]
    NotAccepted { round: u64, node: NodeId },
    /// The node was not asked for the lost file.
    #[error("round {round} cannot leave out the contribution of node {node}: no entry records that a file of it is lost")]
    NotAskedFor { round: u64, node: NodeId },
    /// The node may still send the lost file.
    #[error("round {round} cannot leave out the contribution of node {node} yet: the node is asked for its files for another {early_ms} ms")]
    LeftOutEarly {
        round: u64,
        node: NodeId,
        early_ms: u64,
    },
    /// The commitments are not closed.
    #[error("the randomness of round {0} cannot be drawn before its commitments are closed")]
    NotClosed(u64),
    /// The randomness is too late.
    #[error("the randomness of round {round} comes {late_ms} ms too late")]
    RandomnessLate { round: u64, late_ms: u64 },
    /// The source determines another randomness.
    #[error("the randomness of round {round}: {error}")]
    BadRandomness { round: u64, error: RandomnessError },
    /// Another reason for the refusal is true.
    #[error("the recorded reason for the refusal is '{given}', but {found}")]
    WrongReason { given: String, found: String },
    /// The operator cannot enrol nodes here.
    #[error("the operator cannot enrol node {0}: by the rules, only a vote can")]
    EnrolmentByVote(NodeId),
    /// The operator cannot suspend nodes here.
    #[error("the operator cannot suspend or reinstate node {0}: by the rules, only a vote can")]
    SuspensionByVote(NodeId),
    /// Somebody else decides as the operator.
    #[error("{0} is not the operator: its key is not the one that the genesis names")]
    NotOperator(NodeId),
    /// The two halves of a change of the log's key differ.
    #[error("the log's key cannot become {0}: the new key signed another change")]
    OtherLogTakeover(NodeId),
    /// The change of the log's key is for another log.
    #[error("the operator has signed a new key for the log '{found}', and this is the log '{expected}': sign again")]
    OtherLog { found: String, expected: String },
    /// The change of the log's key is for another place in the log.
    #[error("the operator has signed that entry {entry} changes the log's key, but the next entry is {next}: sign again")]
    OtherLogKeyEntry { entry: u64, next: u64 },
    /// The log's new key is in use, or was.
    #[error("the log's key cannot become {0}: the log, a node or a governor has or had this key; make another one")]
    UsedKey(NodeId),
    /// The operator's decision has another number.
    #[error("the operator's decision has number {number}, but the next one has number {next}: sign again")]
    OtherDecision { number: u64, next: u64 },
    /// The node has committed in the open round.
    #[error("node {node} cannot be suspended yet: it has committed an update in round {round}, which is open; ask again when the round is over")]
    SuspendedInRound { node: NodeId, round: u64 },
    /// The operator ends only its own suspensions.
    #[error("the operator cannot reinstate node {node}: it is {standing}, and the operator ends only its own suspensions")]
    NotReinstated { node: NodeId, standing: Standing },
    /// The two halves of a key rotation differ.
    #[error("node {0}'s key cannot be rotated: the new key signed another rotation")]
    OtherTakeover(NodeId),
    /// The node has used its key in the open round.
    #[error("node {node} cannot change its key: it has committed an update in round {round}, which is open")]
    KeyInUse { node: NodeId, round: u64 },
    /// The node has committed in the open round.
    #[error("node {node} cannot leave yet: it has committed an update in round {round}, which is open; leave when the round is over")]
    LeavesRound { node: NodeId, round: u64 },
    /// The node has signed to leave at another time.
    #[error("node {node} has signed that round {round} is the first one without it, but the next round is {next}: sign again")]
    OtherLeaving { node: NodeId, round: u64, next: u64 },
    /// The round requires more nodes than there are.
    #[error("round {round} cannot open: {nodes} nodes may contribute to it, and the rules ask for {least} that are present")]
    TooFewNodes {
        round: u64,
        nodes: usize,
        least: usize,
    },
    /// The new key is a governor's.
    #[error("{0} is the key of a governor already: make another key")]
    GovernorsKey(NodeId),
    /// The key was changed too often.
    #[error("{node} has changed its key {limit} times: only a vote can give it another")]
    TooManyKeys { node: NodeId, limit: usize },
    /// The proposal is not possible.
    #[error("proposal {number}: {why}")]
    BadProposal { number: u64, why: String },
    /// No governor, and no node with enough credits.
    #[error("{0} may not vote here: it is neither a governor nor a node with enough credits")]
    NoVote(NodeId),
    /// The proposal is not open.
    #[error("proposal {0} is not open")]
    ProposalNotOpen(u64),
    /// The voter signed a vote on another proposal of this number.
    #[error("the vote is on the proposal with digest {found}, but proposal {number} has digest {expected}: it is another one")]
    OtherProposal {
        number: u64,
        found: Digest,
        expected: Digest,
    },
    /// The vote or veto is too late.
    #[error("a {what} on proposal {number} comes {late_ms} ms too late")]
    VoteClosed {
        number: u64,
        what: String,
        late_ms: u64,
    },
    /// The veto comes during the vote.
    #[error("a veto on proposal {number} comes {early_ms} ms too early: vote against it, or wait for the end of the vote")]
    VetoEarly { number: u64, early_ms: u64 },
    /// The voter has already voted.
    #[error("{voter} has voted on proposal {number} already; votes are final")]
    VotedTwice { number: u64, voter: NodeId },
    /// Votes or vetoes are still possible.
    #[error("proposal {number} cannot be settled for another {early_ms} ms")]
    SettledEarly { number: u64, early_ms: u64 },
    /// The recorded outcome is not the true one.
    #[error("proposal {number} is settled as '{found}', but it is {expected}")]
    OtherOutcome {
        number: u64,
        found: String,
        expected: String,
    },
    /// A due proposal prevents the round's opening.
    #[error("proposal {0} has to be settled before a round opens")]
    ProposalDue(u64),
    /// The dispute, or its end, is impossible.
    #[error("dispute about entry {entry}: {why}")]
    BadDispute { entry: u64, why: String },
    /// A dispute prevents the round's opening.
    #[error("the dispute of entry {0} has to be decided before a round opens")]
    DisputeUndecided(u64),
    /// The open round waits for no deadline.
    #[error("round {0} has no deadline that could move: all that it waits for is decided")]
    NoDeadline(u64),
    /// The deadlines move by more than the outage, or than all outages of a round may.
    #[error("the deadline of round {round} cannot move by {by_ms} ms: {most_ms} ms have passed since the last entry but votes and the operator's, or are left of 30 days for all outages of a phase")]
    MovedTooFar {
        round: u64,
        by_ms: u64,
        most_ms: u64,
    },
    /// The outage is too short, and no deadline passed in it.
    #[error("the deadline of round {0} does not move by an outage of less than a minute in which it did not pass")]
    ShortOutage(u64),
    /// The deadlines do not fit in 64 bits.
    #[error("round {0}'s deadlines do not fit in 64 bits")]
    EndOfTime(u64),
}

impl From<RefusalCode> for RuleViolation {
    fn from(code: RefusalCode) -> Self {
        Self::Refused(code.into())
    }
}
