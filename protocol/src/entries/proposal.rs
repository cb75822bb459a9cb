//! What a proposal changes, how people vote on it, and how it ends.

use crate::entries::member::NodeEnrolled;
use crate::entries::program::Program;
use crate::entries::proposal::impossible::Impossible;
use crate::rules::network_rules::Rules;
use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::NodeId;

pub mod impossible;

/// What a proposal does once it is executed.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Action {
    /// These rules replace all present rules, from the next round on.
    ChangeRules(Box<Rules>),
    /// A node joins.
    Enrol(NodeEnrolled),
    /// A node may not contribute until it is reinstated.
    Suspend(NodeId),
    /// A suspended node may contribute again.
    Reinstate(NodeId),
    /// A node may never contribute again.
    Revoke(NodeId),
    /// A node gets another key, because its own is lost or stolen.
    ReplaceKey {
        /// The node.
        node: NodeId,
        /// Its new identity.
        with: NodeId,
    },
    /// A dispute that rests on a document is decided by vote.
    JudgeDispute {
        /// Index of the entry that raised it.
        dispute: u64,
        /// Whether the contribution was false.
        upheld: bool,
    },
    /// From the next round on, proofs are of this guest program.
    ReplaceProgram(Program),
    /// The next round starts from the global weights that an earlier round ended with.
    RestoreWeights {
        /// The number of that round.
        round: u64,
    },
}

/// How somebody votes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Ballot {
    /// For the proposal.
    For,
    /// Against the proposal.
    Against,
    /// Neither for nor against. It counts towards the quorum.
    Abstain,
    /// Stops a proposal that has passed. A veto is possible only during the time lock, after the vote.
    Veto,
}

/// What became of a proposal.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Outcome {
    /// It passed, and its action was executed.
    Executed,
    /// Too little weight took part.
    NoQuorum,
    /// Too little of the weight that took part was for it.
    Rejected,
    /// It passed, and vetoes stopped it.
    Vetoed,
    /// It passed, but its action was not possible any more. Every replay computes why, and compares.
    Impossible(Impossible),
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
