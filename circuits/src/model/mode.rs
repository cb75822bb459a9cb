//! The ways to prove an evaluation.

use borsh::{BorshDeserialize, BorshSerialize};
use core::fmt;

/// How an evaluation is proven.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Mode {
    /// Samples and weights enter the guest, and the guest evaluates both models.
    Direct,
    /// The prover makes an argument natively that both evaluations are right, and the guest verifies it. Neither samples nor weights enter the
    /// guest, and the verifier looks at the weights at random points.
    Succinct,
}

impl Mode {
    /// All modes.
    pub const ALL: [Self; 2] = [Self::Direct, Self::Succinct];
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Direct => "direct",
            Self::Succinct => "succinct",
        })
    }
}

/// A text does not name a [`Mode`].
#[cfg(feature = "std")]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown mode '{0}'; the modes are direct and succinct")]
pub struct UnknownMode(String);

#[cfg(feature = "std")]
impl core::str::FromStr for Mode {
    type Err = UnknownMode;

    fn from_str(text: &str) -> Result<Self, UnknownMode> {
        match text {
            "direct" => Ok(Self::Direct),
            "succinct" => Ok(Self::Succinct),
            _ => Err(UnknownMode(text.into())),
        }
    }
}
