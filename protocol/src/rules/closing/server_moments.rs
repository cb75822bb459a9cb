//! The moments of FedAdam: the server's state between rounds besides the weights.
//!
//! They depend on all rounds since they began, not on the ledger's weights. So they are a blob, with its digest on the ledger.
//! Anyone with the round's updates and the earlier moments can recompute it.
//!
//! They start at zero with the first round by FedAdam, after a round by another strategy, and after a vote that restored weights.
//! A round that keeps its base keeps its moments: a rejected result must not move later rounds.

use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::Digest;

/// The moments that a round starts with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct ServerMoments {
    /// SHA-256 of their file.
    pub blob: Digest,
    /// The rounds behind them; at least 1.
    pub steps: u64,
}

impl ServerMoments {
    /// The rounds behind moments; 0 without any.
    pub fn steps(moments: Option<&Self>) -> u64 {
        moments.map_or(0, |moments| moments.steps)
    }
}
