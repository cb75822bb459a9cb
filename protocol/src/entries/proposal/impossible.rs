//! Why a passed proposal is not executed.

use crate::entries::member::Standing;
use crate::rules::round_results::REMEMBERED_RESULTS;
use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::NodeId;

/// Why a proposal's action is not possible. As with refusals, a code and its number never change, but its sentence (`Display`)
/// may.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
#[borsh(use_discriminant = true)]
#[repr(u8)]
pub enum Impossible {
    /// No network can have these rules.
    Rules = 1,
    /// No node can have this key.
    BadKey(NodeId) = 2,
    /// The key belongs or belonged to a node.
    KeyUsed(NodeId) = 3,
    /// The node has committed in the open round with its present key.
    KeyInUse { node: NodeId, round: u64 } = 4,
    /// The node cannot be enrolled for another reason, such as its name.
    Enrolment(NodeId) = 5,
    /// The node is not enrolled.
    NotEnrolled(NodeId) = 6,
    /// The action needs another standing of the node.
    Standing { node: NodeId, standing: Standing } = 7,
    /// That entry is no open dispute.
    NoDispute(u64) = 8,
    /// Verification, not a vote, decides that entry's dispute.
    NotByVote(u64) = 9,
    /// No network can have this guest program.
    Program = 10,
    /// The round has not opened yet.
    NoRound(u64) = 11,
    /// The round is open and has no result.
    RoundOpen(u64) = 12,
    /// The ledger has forgotten the round's weights.
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
