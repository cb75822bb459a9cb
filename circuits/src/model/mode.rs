//! The two ways to prove the evaluation's matrix products.

use borsh::{BorshDeserialize, BorshSerialize};
use core::fmt;

/// How matrix products are proven.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Mode {
    /// The weights enter the guest, and the guest computes the products.
    Direct,
    /// The prover hints the products, the guest checks them, and the verifier projects the weights.
    Checked,
}

impl Mode {
    /// All modes.
    pub const ALL: [Self; 2] = [Self::Direct, Self::Checked];
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Direct => "direct",
            Self::Checked => "checked",
        })
    }
}

/// A text does not name a [`Mode`].
#[cfg(feature = "std")]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown mode '{0}'; the modes are direct and checked")]
pub struct UnknownMode(String);

#[cfg(feature = "std")]
impl core::str::FromStr for Mode {
    type Err = UnknownMode;

    fn from_str(text: &str) -> Result<Self, UnknownMode> {
        match text {
            "direct" => Ok(Self::Direct),
            "checked" => Ok(Self::Checked),
            _ => Err(UnknownMode(text.into())),
        }
    }
}
