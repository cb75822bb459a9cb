//! How much an audit reads.

use borsh::{BorshDeserialize, BorshSerialize};

/// An audit's depth.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, BorshSerialize, BorshDeserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Depth {
    /// Entries and proofs, without weights and frame lists. Does not check averages, datasets, or that updates are what was proven, on
    /// which a proof in mode `succinct` depends.
    Light,
    /// Everything at hand.
    #[default]
    Full,
}

impl Depth {
    /// [`Self::Light`] or [`Self::Full`].
    pub fn of(light: bool) -> Self {
        if light {
            Self::Light
        } else {
            Self::Full
        }
    }
}
