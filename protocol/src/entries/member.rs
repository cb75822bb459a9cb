//! Members of a network.

use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::NodeId;

/// A node joined.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct NodeEnrolled {
    /// Its key.
    pub node: NodeId,
    /// A readable name.
    pub name: String,
}

/// Whether a node may contribute.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Standing {
    /// The node may contribute.
    Active,
    /// Suspended by a vote or an upheld dispute, until a vote reinstates the node.
    Suspended,
    /// The node may never contribute again.
    Revoked,
    /// The node has left. It may be enrolled again.
    Left,
    /// Suspended by the operator, until the operator or a vote reinstates the node.
    SuspendedByOperator,
}

impl Standing {
    /// Whether a node's credits vote. The operator's suspensions take no votes; otherwise it could decide about proposals.
    pub fn votes(self) -> bool {
        matches!(self, Self::Active | Self::SuspendedByOperator)
    }
}

impl std::fmt::Display for Standing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Active => "active",
            Self::Suspended => "suspended",
            Self::Revoked => "revoked",
            Self::Left => "gone: it has left",
            Self::SuspendedByOperator => "suspended by the operator",
        })
    }
}
