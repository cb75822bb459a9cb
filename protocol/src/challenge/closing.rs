//! How a round's commitments closed. This and the source determine the randomness.

use crate::entries::signed::UpdateCommitment;
use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::{Digest, NodeId};

/// The closing of a round's commitments: no more are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct CommitmentsClosing {
    /// Index of the closing entry.
    pub entry: u64,
    /// Its time, in Unix milliseconds.
    pub time_ms: u64,
    /// Root of the tree that ends with it.
    pub root: Digest,
    /// Digest of all commitments: see [`commitments`].
    pub commitments: Digest,
}

/// The digest of a commitment's statement, without signature and time: a node can make many signatures of one statement.
pub fn commitment(statement: &UpdateCommitment) -> Digest {
    let bytes = borsh::to_vec(statement).expect("writing to a Vec cannot fail");
    tagged_sha256("zk0/commitment/v1", &[&bytes])
}

/// The digest of a round's commitments, by ascending node, without the entries' order, times and signatures. So the aggregator
/// can vary it only by leaving out a commitment, which has a receipt or a signed promise.
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
