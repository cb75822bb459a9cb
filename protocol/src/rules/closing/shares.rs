//! How much each contribution counts in a round's average.
//!
//! A node's number of committed samples may be different scenes or one scene in ten thousand variants. So it counts little or
//! nothing: by default all contributions count alike, and otherwise at most as a few times the median contributor. Shares depend
//! on all contributors, so they are set when the round closes.

use crate::rules::basis_points::BPS;
use borsh::{BorshDeserialize, BorshSerialize};
use serde::{Deserialize, Serialize};

/// The median contributor's share, in basis points of itself.
pub const WHOLE_SHARE: u32 = BPS;

/// A hundred times the median contributor's share.
const MAX_SHARE: u32 = 100 * WHOLE_SHARE;

/// How much each contribution counts in the average and in its credits. Only some strategies average by shares
/// ([`crate::rules::network_rules::Strategy`]).
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize,
)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Shares {
    /// All contributions count alike.
    Equal,
    /// By committed samples, up to a limit near their median.
    Samples {
        /// The limit, in basis points of the median; 10,000 to 1,000,000.
        max_of_median_bps: u32,
    },
}

impl Shares {
    /// The shares of a round's contributions, in basis points of the median contributor. `samples` are their committed numbers of
    /// samples, in the same order.
    ///
    /// With [`Shares::Samples`], the share of `n` samples is `n · 10,000 / m`, rounded down, at least 1, and at most the limit.
    /// `m` is the median of `samples`; for an even number, the smaller of the middle two, so that half of the contributors cannot
    /// raise it.
    pub fn of(&self, samples: &[u64]) -> Vec<u32> {
        let limit = match self {
            Self::Equal => return vec![WHOLE_SHARE; samples.len()],
            Self::Samples { max_of_median_bps } => *max_of_median_bps,
        };
        let mut sorted = samples.to_vec();
        sorted.sort_unstable();
        let middle = sorted.len().saturating_sub(1) / 2;
        let median = u128::from(sorted.get(middle).copied().unwrap_or(1).max(1));
        let share = |samples: &u64| {
            let share = u128::from(*samples) * u128::from(WHOLE_SHARE) / median;
            u32::try_from(share)
                .unwrap_or(u32::MAX)
                .clamp(1, limit.max(1))
        };
        samples.iter().map(share).collect()
    }

    /// Checks the limit.
    pub fn check(&self) -> Result<(), String> {
        match self {
            Self::Samples { max_of_median_bps }
                if !(WHOLE_SHARE..=MAX_SHARE).contains(max_of_median_bps) =>
            {
                Err(format!(
                    "rule shares limits a contribution to {max_of_median_bps} basis points of the median; it has to be between \
                     {WHOLE_SHARE} and {MAX_SHARE}"
                ))
            }
            _ => Ok(()),
        }
    }
}
