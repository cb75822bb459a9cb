//! A node's part of a network's history.

use serde::Serialize;

/// A node.
#[derive(Clone, Debug, Serialize, Default)]
pub struct NodeHistory {
    /// The identity.
    pub id: String,
    /// The name that it chose.
    pub name: String,
    /// The entry of the enrolment.
    pub enrolled_entry: u64,
    /// Samples of the present dataset.
    pub samples: u64,
    /// Updates committed.
    pub committed: u64,
    /// Contributions accepted.
    pub accepted: u64,
    /// Contributions refused.
    pub refused: u64,
    /// Commitments without a claim.
    pub unanswered: u64,
    /// Total earnings.
    pub credits: u64,
}

impl NodeHistory {
    /// The share of accepted among decided contributions.
    pub fn acceptance(&self) -> Option<f64> {
        let decided = self.accepted + self.refused;
        (decided > 0).then(|| self.accepted as f64 / decided as f64)
    }
}
