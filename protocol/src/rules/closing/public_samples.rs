//! The network's public samples. A round's result is evaluated on them before it is taken as the new global weights.
//!
//! Each contribution was proven to lower the loss on its own node's samples. That says nothing of what the contributions combine to:
//! an average can overflow, or be much worse, and would then stop or spoil every round after it. So the rules name samples that
//! everybody has, best of tasks that no node trains on, and by how much their loss may rise in a round.

use crate::entries::round_result::{PublicLoss, ResultOutcome};
use crate::rules::basis_points::BPS;
use borsh::{BorshDeserialize, BorshSerialize};
use serde::{Deserialize, Serialize};
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::Digest;

/// Most public samples. Each round evaluates all of them twice.
pub const MAX_PUBLIC_SAMPLES: u32 = 1024;

/// Largest file of public samples, in bytes: 280 samples of the published size.
pub const MAX_PUBLIC_SAMPLES_BYTES: u64 = 1 << 30;

/// Largest rise of the loss that the rules can allow: a hundred times the base's loss.
const MAX_INCREASE: u32 = 100 * BPS;

/// The samples on which the results of rounds are evaluated, and what a result has to reach there.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize,
)]
#[serde(deny_unknown_fields)]
pub struct PublicSamples {
    /// SHA-256 of the file of samples: [`zk0_circuits::model::sample::Sample::as_bytes`], one after another.
    #[serde(with = "digest_text")]
    pub blob: Digest,
    /// How many samples it holds; 1 to [`MAX_PUBLIC_SAMPLES`].
    pub samples: u32,
    /// By how much a result's loss may be larger than the base's, in basis points of the base's; at most 1,000,000.
    pub max_loss_increase_bps: u32,
}

impl PublicSamples {
    /// The seed of the samples' flow times and noise: [`tagged_sha256`] of the network and the file under `zk0/public-samples/v1`. It is the
    /// same in every round, so that the losses of different rounds compare.
    pub fn seed(&self, network: &Digest) -> Digest {
        tagged_sha256("zk0/public-samples/v1", &[&network.0, &self.blob.0])
    }

    /// Whether a result with this loss is taken, where the base has that one. A result is an improvement on a base that overflows.
    pub fn outcome(&self, base: &PublicLoss, result: &PublicLoss) -> ResultOutcome {
        let (base, result) = match (base, result) {
            (_, PublicLoss::Overflow { .. }) => return ResultOutcome::Overflow,
            (PublicLoss::Overflow { .. }, _) => return ResultOutcome::Taken,
            (PublicLoss::SquaredError(base), PublicLoss::SquaredError(result)) => (base, result),
        };
        let allowed =
            u128::from(*base) * u128::from(BPS.saturating_add(self.max_loss_increase_bps));
        if u128::from(*result) * u128::from(BPS) <= allowed {
            ResultOutcome::Taken
        } else {
            ResultOutcome::Worse
        }
    }

    /// Checks the numbers. The error says what is wrong with them.
    pub fn check(&self) -> Result<(), String> {
        if !(1..=MAX_PUBLIC_SAMPLES).contains(&self.samples) {
            return Err(format!(
                "rule public_samples names {} samples; 1 to {MAX_PUBLIC_SAMPLES} are possible",
                self.samples
            ));
        }
        match self.max_loss_increase_bps {
            bps if bps > MAX_INCREASE => Err(format!(
                "rule public_samples lets the loss rise by {bps} basis points; at most {MAX_INCREASE} are possible"
            )),
            _ => Ok(()),
        }
    }
}

/// Digests in JSON: hexadecimal text.
mod digest_text {
    use super::Digest;
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(digest: &Digest, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(digest)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Digest, D::Error> {
        let text = String::deserialize(deserializer)?;
        text.parse().map_err(D::Error::custom)
    }
}
