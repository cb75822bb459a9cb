//! The claim: the public values of a proof, one versioned struct with one canonical (borsh) encoding.

use crate::{DatasetCommitment, Digest, NodeId};
use borsh::{BorshDeserialize, BorshSerialize};

/// Version of the encoding and meaning of [`Claim`].
pub const CLAIM_VERSION: u16 = 2;

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
    /// What the verifier has to check of the weights in mode `checked`; `None` in mode `direct`.
    pub weight_check: Option<WeightCheck>,
}

/// The products that the guest took on trust in its projections of the weight matrices: the verifier expands the coefficients
/// from `seed`, projects the matrices of both files with them ([`crate::projection`]), and compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct WeightCheck {
    /// What the coefficients are expanded from: the hash of header and hinted products.
    pub seed: Digest,
    /// What of the base weights was in the guest.
    pub base: GuestWeights,
    /// What of the update was in the guest.
    pub update: GuestWeights,
}

/// What of a set of weights enters the guest in mode `checked`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct GuestWeights {
    /// Digest of norm gains and biases.
    pub parameters: Digest,
    /// Digest of the matrices' projections.
    pub projections: Digest,
}

/// A set of expert weights, as bytes and as numbers.
#[derive(Default, Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct WeightsDigest {
    /// SHA-256 of the safetensors file.
    pub blob: Digest,
    /// Digest of the quantised weights, [`crate::QuantisedWeights::digest`]: computed in the guest in mode `direct`. The
    /// verifier recomputes it from the file in either.
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
