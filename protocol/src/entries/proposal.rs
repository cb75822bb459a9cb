//! What a proposal asks for, how people vote on it, and how it ends.

use crate::{entries::member::NodeEnrolled, rules::network_rules::Rules};
use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::NodeId;

/// What a proposal does once it is executed.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Action {
    /// These rules, all of them, from the next round on.
    ChangeRules(Box<Rules>),
    /// A node joins.
    Enrol(NodeEnrolled),
    /// A node may not contribute until it is reinstated.
    Suspend(NodeId),
    /// A suspended node may contribute again.
    Reinstate(NodeId),
    /// A node may never contribute again.
    Revoke(NodeId),
    /// Another key takes a node's place, whose own is lost or stolen.
    ReplaceKey {
        /// The node.
        node: NodeId,
        /// Its new identity.
        with: NodeId,
    },
    /// A dispute that no program can decide is decided.
    JudgeDispute {
        /// Index of the entry that raised it.
        dispute: u64,
        /// Whether the contribution was false.
        upheld: bool,
    },
}

/// One voter's say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Ballot {
    /// For it.
    For,
    /// Against it.
    Against,
    /// Neither, but counted towards the quorum.
    Abstain,
    /// Stop it: in the time lock alone, after the vote.
    Veto,
}

/// What became of a proposal.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Outcome {
    /// It passed and is done.
    Executed,
    /// Not enough weight took part.
    NoQuorum,
    /// Not enough of it was for it.
    Rejected,
    /// It passed and was stopped.
    Vetoed,
    /// It passed, but what it asks for is not possible any more, and why.
    Impossible(String),
}

impl std::fmt::Display for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Executed => f.write_str("executed"),
            Self::NoQuorum => f.write_str("without a quorum"),
            Self::Rejected => f.write_str("rejected"),
            Self::Vetoed => f.write_str("vetoed"),
            Self::Impossible(why) => write!(f, "passed, but impossible: {why}"),
        }
    }
}
