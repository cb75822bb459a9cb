//! How the commitments of a round closed. The randomness follows from this, and from its source.

use crate::entries::signed::UpdateCommitment;
use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::{Digest, NodeId};

/// A round's commitments are closed: nobody commits any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct CommitmentsClosing {
    /// Index of the entry that closed them.
    pub entry: u64,
    /// Time of that entry, in Unix milliseconds.
    pub time_ms: u64,
    /// Root of the tree that ends with that entry.
    pub root: Digest,
    /// Digest of all commitments: see [`commitments`].
    pub commitments: Digest,
}

/// The digest of one commitment. It covers what the node stated, and neither its signature nor when it was recorded: a node can choose
/// among many signatures of one statement.
pub fn commitment(statement: &UpdateCommitment) -> Digest {
    let bytes = borsh::to_vec(statement).expect("writing to a Vec cannot fail");
    tagged_sha256("zk0/commitment/v1", &[&bytes])
}

/// The digest of all commitments of a round, in ascending order of their nodes. It depends neither on the order of the entries, nor on
/// their times or signatures, so the aggregator cannot vary it either, except by leaving a commitment out. A node whose commitment is
/// left out has a receipt for it, or a signed promise.
pub fn commitments<'a>(
    network: &Digest,
    round: u64,
    by_node: impl Iterator<Item = (&'a NodeId, &'a Digest)>,
) -> Digest {
    let listed: Vec<u8> = by_node
        .flat_map(|(node, commitment)| [node.0, commitment.0].concat())
        .collect();
    tagged_sha256(
        "zk0/commitments/v1",
        &[&network.0, &round.to_le_bytes(), &listed],
    )
}
