//! The sources of randomness in a network's rules. docs/claim.md describes what each resists.

use crate::challenge::drand::DrandChain;
use borsh::{BorshDeserialize, BorshSerialize};
use serde::{Deserialize, Serialize};
use std::fmt;

/// The source of a network's challenges.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum RandomnessSource {
    /// A verifiable random function of the log's key, for the commitments. No node can compute it. The aggregator can, for any
    /// commitments, so networks must trust it not to conspire with a node.
    LogVrf,
    /// All witnesses' cosignatures of the checkpoint that ends with the closing of the commitments.
    Witnesses,
    /// A public beacon.
    Drand(Box<DrandChain>),
}

impl RandomnessSource {
    /// Checks the source. `has_witnesses`: whether the rules name witnesses. `window_ms`: how long a round waits for randomness.
    pub fn check(&self, has_witnesses: bool, window_ms: u64) -> Result<(), String> {
        let bad = |why: String| format!("rule randomness: {why}");
        match self {
            Self::LogVrf => Ok(()),
            Self::Witnesses if has_witnesses => Ok(()),
            Self::Witnesses => Err(bad(
                "it takes the witnesses' cosignatures, but rule witness_policy names no witnesses"
                    .into(),
            )),
            Self::Drand(chain) => {
                chain.check().map_err(bad)?;
                let latest_ms = chain.latest_after_closing_ms();
                if window_ms > latest_ms {
                    Ok(())
                } else {
                    Err(format!(
                        "rule randomness_window_ms is {window_ms}, but a beacon can come {latest_ms} ms after the closing (margin_ms of {} and a period of {} s), so that rounds would end without randomness: set randomness_window_ms to more than that, or margin_ms to less",
                        chain.margin_ms, chain.period_s
                    ))
                }
            }
        }
    }
}

impl fmt::Display for RandomnessSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LogVrf => f.write_str("the VRF of the log's key"),
            Self::Witnesses => f.write_str("the witnesses' cosignatures"),
            Self::Drand(chain) => write!(f, "drand chain {}", hex::encode(chain.hash)),
        }
    }
}
