//! Why the action of a proposal that passed is not carried out.

use crate::entries::member::Standing;
use crate::rules::round_results::REMEMBERED_RESULTS;
use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::NodeId;

/// Why the action of a proposal is not possible. As with refusals, a code and its number never change, and its sentence
/// (`Display`) may change at any time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
#[borsh(use_discriminant = true)]
#[repr(u8)]
pub enum Impossible {
    /// No network can have these rules.
    Rules = 1,
    /// No node can have this key.
    BadKey(NodeId) = 2,
    /// The key belongs to a node, or did so.
    KeyUsed(NodeId) = 3,
    /// The node has committed in the open round with the key that it has.
    KeyInUse { node: NodeId, round: u64 } = 4,
    /// The node cannot be enrolled for another reason, such as its name.
    Enrolment(NodeId) = 5,
    /// The node is not enrolled.
    NotEnrolled(NodeId) = 6,
    /// The node has another standing than the action needs.
    Standing { node: NodeId, standing: Standing } = 7,
    /// That entry is no open dispute.
    NoDispute(u64) = 8,
    /// Verification decides about the dispute of that entry, not a vote.
    NotByVote(u64) = 9,
    /// No network can have this guest program.
    Program = 10,
    /// The round is still to come.
    NoRound(u64) = 11,
    /// The round is open, so that it has not ended with any weights.
    RoundOpen(u64) = 12,
    /// The ledger does not remember the weights of the round any more.
    RoundForgotten(u64) = 13,
}

impl std::fmt::Display for Impossible {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Rules => f.write_str("no network can have these rules"),
            Self::BadKey(key) => write!(f, "no node can have the key {key}"),
            Self::KeyUsed(key) => write!(f, "node {key} is already enrolled"),
            Self::KeyInUse { node, round } => write!(
                f,
                "node {node} has committed in round {round}, so it keeps its key until the round closes"
            ),
            Self::Enrolment(node) => write!(f, "node {node} cannot be enrolled"),
            Self::NotEnrolled(node) => write!(f, "node {node} is not enrolled in this network"),
            Self::Standing { node, standing } => write!(f, "node {node} is {standing}"),
            Self::NoDispute(entry) => write!(f, "entry {entry} is no open dispute"),
            Self::NotByVote(entry) => write!(
                f,
                "verification decides about the dispute of entry {entry}, not a vote"
            ),
            Self::Program => f.write_str("no network can have this guest program"),
            Self::NoRound(round) => write!(f, "there is no round {round} yet"),
            Self::RoundOpen(round) => write!(
                f,
                "round {round} is still open, so it has not ended with any weights"
            ),
            Self::RoundForgotten(round) => write!(
                f,
                "round {round} is too long ago: the ledger remembers the weights of the last {REMEMBERED_RESULTS} rounds"
            ),
        }
    }
}
