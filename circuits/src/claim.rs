//! The claim: the public values of a proof, one versioned struct with one canonical (borsh) encoding.

use crate::{DatasetCommitment, Digest, NodeId};
use borsh::{BorshDeserialize, BorshSerialize};

/// Version of the encoding and meaning of [`Claim`].
pub const CLAIM_VERSION: u16 = 1;

/// *With samples chosen by `challenge` from the committed dataset, the mean flow-matching loss of the update is lower
/// than that of the base weights by at least `min_improvement_bps`.*
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Claim {
    /// [`CLAIM_VERSION`].
    pub version: u16,
    /// The network: digest of its genesis.
    pub network: Digest,
    /// The round the contribution is for.
    pub round: u64,
    /// The contributing node.
    pub node: NodeId,
    /// The dataset, committed before the round.
    pub dataset: DatasetCommitment,
    /// Digest of the evaluation specification: dimensions, activation scales, time frequencies. Fixed by the round.
    pub evaluation: Digest,
    /// Weights the round started from.
    pub base: WeightsDigest,
    /// Weights contributed.
    pub update: WeightsDigest,
    /// Fixes the samples, the flow times and the noise; derived from the ledger after the update was committed.
    pub challenge: Digest,
    /// Number of samples evaluated.
    pub eval_samples: u32,
    /// Least relative improvement claimed, in basis points (1/100 of a percent).
    pub min_improvement_bps: u32,
    /// What the network's disclosure rule allows of the losses.
    pub losses: Losses,
    /// Transcript digest of the weight check in `checked` mode; `None` in `direct` mode.
    pub weight_check: Option<Digest>,
}

/// A set of expert weights, as bytes and as numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct WeightsDigest {
    /// SHA-256 of the safetensors file.
    pub blob: Digest,
    /// Poseidon2 digest of the quantised weights: what the guest evaluated. The verifier recomputes it from the file.
    pub quantised: Digest,
}

/// The losses a proof discloses.
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

/// For people: a claim's losses in the units that training prints.
#[cfg(feature = "std")]
impl Losses {
    /// Mean squared error per element under the base weights and under the update, if disclosed.
    pub fn means(&self, spec: &crate::EvalSpec) -> Option<(f64, f64)> {
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
