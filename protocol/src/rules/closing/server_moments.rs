//! The moments of FedAdam: what the server keeps from round to round besides the weights.
//!
//! They follow from all rounds since they began, and not from weights that are on the ledger. So they are a file among the blobs, whose
//! digest is on the ledger. Whoever has the round's updates and the moments before it computes the file again.
//!
//! The moments begin afresh with the first round by FedAdam, after a round by another strategy, and after a vote that restored weights. A
//! round that keeps its base keeps its moments, too: what nobody has taken must not move later rounds.

use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::Digest;

/// The moments that a round starts with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct ServerMoments {
    /// SHA-256 of their file.
    pub blob: Digest,
    /// From how many rounds they follow; at least 1.
    pub steps: u64,
}

impl ServerMoments {
    /// How many rounds moments follow from, which need not be there.
    pub fn steps(moments: Option<&Self>) -> u64 {
        moments.map_or(0, |moments| moments.steps)
    }
}
