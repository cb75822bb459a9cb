//! How much an audit reads.

use borsh::{BorshDeserialize, BorshSerialize};

/// How much an audit reads.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, BorshSerialize, BorshDeserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Depth {
    /// Entries and proofs, but no weights and no lists of drawn frames. A light audit does not check that updates are what was proven (in
    /// mode `succinct`, a proof depends on that), and it checks neither averages nor datasets.
    Light,
    /// Everything that is at hand.
    #[default]
    Full,
}

impl Depth {
    /// The depth of an audit that is light, or is not.
    pub fn of(light: bool) -> Self {
        if light {
            Self::Light
        } else {
            Self::Full
        }
    }
}
