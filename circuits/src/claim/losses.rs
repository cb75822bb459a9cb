//! What a proof discloses of the losses: the network's rule, and what a claim then holds.

use borsh::{BorshDeserialize, BorshSerialize};
use core::fmt;

/// What the network's rule lets a claim disclose of the losses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum Disclosure {
    /// Only that the loss went down by the minimum.
    Nothing,
    /// Both losses.
    Losses,
}

impl fmt::Display for Disclosure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Nothing => "nothing",
            Self::Losses => "losses",
        })
    }
}

/// The losses that a claim discloses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Losses {
    /// The network's rule keeps them private.
    Hidden,
    /// Sums of squared errors over the same elements, in units of 2^-(2·fraction bits of the velocity).
    Disclosed {
        /// Sum under the base weights.
        before: u64,
        /// Sum under the update.
        after: u64,
        /// Number of elements summed: unpadded frames × real action dimensions, over all samples.
        elements: u64,
    },
}

impl Losses {
    /// The rule under which a claim holds these losses.
    pub fn disclosure(&self) -> Disclosure {
        match self {
            Self::Hidden => Disclosure::Nothing,
            Self::Disclosed { .. } => Disclosure::Losses,
        }
    }

    /// Mean squared error per element under the base weights and under the update, if they are disclosed: the unit that
    /// training prints.
    #[cfg(feature = "std")]
    pub fn means(&self, spec: &crate::model::spec::EvalSpec) -> Option<(f64, f64)> {
        let Self::Disclosed {
            before,
            after,
            elements,
        } = *self
        else {
            return None;
        };
        let unit = (elements.max(1) as f64) * 4f64.powi(spec.action.into());
        Some((before as f64 / unit, after as f64 / unit))
    }
}
