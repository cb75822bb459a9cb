//! What a contribution earns.

use crate::rules::basis_points::BPS;
use crate::rules::closing::shares::WHOLE_SHARE;
use borsh::{BorshDeserialize, BorshSerialize};
use serde::{Deserialize, Serialize};
use zk0_circuits::{Claim, Losses};

/// A contribution's credits: the proven improvement in basis points, times its share in the round (1 for the median contributor,
/// and for all if shares are equal), divided by [`CreditRule::bps_per_credit`] and rounded down; at most
/// [`CreditRule::max_per_contribution`]. Members decide what a credit is worth; the ledger uses credits only for votes.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize,
)]
#[serde(deny_unknown_fields)]
pub struct CreditRule {
    /// Basis points of improvement for one credit; at least 1.
    pub bps_per_credit: u64,
    /// Most credits for one contribution; 0 for none.
    pub max_per_contribution: u64,
    /// How long after the round's closing a contribution may be disputed, in milliseconds.
    pub dispute_window_ms: u64,
}

impl CreditRule {
    /// Credits for an improvement by `improvement_bps` with this `share` ([`crate::rules::closing::shares::Shares::of`]).
    pub fn earned(&self, improvement_bps: u64, share: u32) -> u64 {
        let product = u128::from(improvement_bps) * u128::from(share);
        let for_one = u128::from(self.bps_per_credit.max(1)) * u128::from(WHOLE_SHARE);
        u64::try_from(product / for_one)
            .unwrap_or(u64::MAX)
            .min(self.max_per_contribution)
    }
}

/// The improvement that a claim proves, in basis points, rounded down: by the disclosed losses, and at least the minimum.
pub fn improvement_bps(claim: &Claim) -> u64 {
    let least = u64::from(claim.terms.test.min_improvement_bps);
    match claim.losses {
        Losses::Disclosed { before, after, .. } if before > 0 => {
            let gain = u128::from(before.saturating_sub(after)) * u128::from(BPS);
            let bps = gain / u128::from(before);
            u64::try_from(bps).unwrap_or(u64::MAX).max(least)
        }
        _ => least,
    }
}
