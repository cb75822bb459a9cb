//! What a proposal changes, the votes on it, and its end.

use crate::entries::member::NodeEnrolled;
use crate::entries::program::Program;
use crate::entries::proposal::impossible::Impossible;
use crate::rules::network_rules::Rules;
use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::NodeId;

pub mod impossible;

/// What an executed proposal does.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Action {
    /// These rules replace all rules from the next round on.
    ChangeRules(Box<Rules>),
    /// A node joins.
    Enrol(NodeEnrolled),
    /// A node may not contribute until reinstated.
    Suspend(NodeId),
    /// A suspended node may contribute again.
    Reinstate(NodeId),
    /// A node may never contribute again.
    Revoke(NodeId),
    /// A node gets another key: its own is lost or stolen.
    ReplaceKey {
        /// The node.
        node: NodeId,
        /// Its new identity.
        with: NodeId,
    },
    /// A vote decides a dispute that rests on a document.
    JudgeDispute {
        /// Index of the disputing entry.
        dispute: u64,
        /// Whether the contribution was false.
        upheld: bool,
    },
    /// Proofs are of this guest program from the next round on.
    ReplaceProgram(Program),
    /// The next round starts from an earlier round's global weights.
    RestoreWeights {
        /// That round.
        round: u64,
    },
}

/// A vote's choice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Ballot {
    /// For the proposal.
    For,
    /// Against the proposal.
    Against,
    /// Neither. It counts towards the quorum.
    Abstain,
    /// Stops a passed proposal, only during the time lock after the vote.
    Veto,
}

/// A proposal's end.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Outcome {
    /// It passed and was executed.
    Executed,
    /// Too little weight took part.
    NoQuorum,
    /// Too little of that weight was for it.
    Rejected,
    /// It passed, and vetoes stopped it.
    Vetoed,
    /// It passed, but its action was no longer possible. Replays compute and compare the reason.
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
