//! How much an audit reads.

use borsh::{BorshDeserialize, BorshSerialize};

/// How much an audit reads.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, BorshSerialize, BorshDeserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Depth {
    /// Entries and proofs. No weights, so: not that updates are what was proven (in mode `checked`, a proof rests on that),
    /// nor averages, nor datasets' lists of samples.
    Light,
    /// Everything that is at hand.
    #[default]
    Full,
}
