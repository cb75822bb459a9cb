//! The network's public samples. A round's result is evaluated on them before it becomes the global weights.
//!
//! Each contribution lowers the loss on its own node's samples. Their combination may overflow or be much worse, and would stop
//! or spoil all later rounds. So the rules name samples that everybody has, best of tasks without training nodes, and the most
//! that their loss may rise in a round.

use crate::entries::round_result::{PublicLoss, ResultOutcome};
use crate::rules::basis_points::BPS;
use borsh::{BorshDeserialize, BorshSerialize};
use serde::{Deserialize, Serialize};
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::Digest;

/// Most public samples. Each round evaluates them twice.
pub const MAX_PUBLIC_SAMPLES: u32 = 1024;

/// Largest file of public samples, in bytes: 280 samples of the published size.
pub const MAX_PUBLIC_SAMPLES_BYTES: u64 = 1 << 30;

/// A hundred times the base's loss.
const MAX_INCREASE: u32 = 100 * BPS;

/// The samples for evaluating rounds' results, and what a result must reach.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize,
)]
#[serde(deny_unknown_fields)]
pub struct PublicSamples {
    /// SHA-256 of the file: [`zk0_circuits::model::sample::Sample::as_bytes`], one after another.
    #[serde(with = "digest_text")]
    pub blob: Digest,
    /// Their number; 1 to [`MAX_PUBLIC_SAMPLES`].
    pub samples: u32,
    /// How much a result's loss may exceed the base's, in basis points of that; at most 1,000,000.
    pub max_loss_increase_bps: u32,
}

impl PublicSamples {
    /// The seed of the samples' flow times and noise: [`tagged_sha256`] of the network and the file under
    /// `zk0/public-samples/v1`. It never changes, so that rounds' losses compare.
    pub fn seed(&self, network: &Digest) -> Digest {
        tagged_sha256("zk0/public-samples/v1", &[&network.0, &self.blob.0])
    }

    /// Whether a result with this loss is taken. Any result improves on a base that overflows.
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

    /// Checks the numbers.
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
