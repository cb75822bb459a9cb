//! Members of a network: the entry by which a node joins.

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
