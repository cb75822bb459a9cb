//! The rules of a network, fixed in its genesis.

use borsh::{BorshDeserialize, BorshSerialize};

/// What the network's nodes, its aggregator and its auditors hold one another to.
#[derive(
    Clone,
    Debug,
    PartialEq,
    Eq,
    BorshSerialize,
    BorshDeserialize,
    serde::Serialize,
    serde::Deserialize,
)]
pub struct Rules {
    /// Fewest samples a registered dataset may have.
    pub min_dataset_samples: u64,
    /// Samples evaluated per claim.
    pub eval_samples: u32,
    /// Least relative improvement of the loss, in basis points; at least 1.
    pub min_improvement_bps: u32,
    /// Most samples a contribution counts for in FedAvg.
    pub max_weight_samples: u64,
    /// What a proof discloses of the losses.
    pub disclosure: Disclosure,
    /// From a round's opening to the last moment for committing an update, in milliseconds.
    pub commit_window_ms: u64,
    /// From a round's opening to the last moment for submitting a claim, in milliseconds.
    pub submit_window_ms: u64,
    /// Largest update, in bytes.
    pub max_update_bytes: u64,
    /// Largest proof, in bytes.
    pub max_proof_bytes: u64,
}

impl Rules {
    /// Largest file of global weights: as large as an update, and then some for the names and order that the average gives
    /// its tensors.
    pub fn max_base_bytes(&self) -> u64 {
        self.max_update_bytes.saturating_mul(2)
    }
}

/// What a proof discloses of the losses.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    BorshSerialize,
    BorshDeserialize,
    serde::Serialize,
    serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Disclosure {
    /// Only that the loss went down by the minimum.
    Nothing,
    /// Both losses.
    Losses,
}
