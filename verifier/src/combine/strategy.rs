//! From a round's contributions to new global weights, by the strategy in the rules.
//!
//! **Where it rounds**: each tensor's exact numbers are rounded once, to the nearest int16 at their one scale
//! ([`zk0_weights::scale`]); ties go to even. A mean always fits. Where the evaluation does not read, the result has the base's
//! numbers ([`zk0_weights::unread`]).

use crate::combine::bases::Bases;
use crate::combine::blocks::file;
use crate::combine::clipping::clipped_mean;
use crate::combine::contributions::{aligned, WeightedContribution};
use crate::combine::error::CombineError;
use crate::combine::fedavg::{average, mean};
use crate::combine::krum::{krum, multi_krum};
use crate::combine::optimizers::adam::{adam, AdamParameters};
use crate::combine::optimizers::moments::Moments;
use crate::combine::optimizers::momentum::with_momentum;
use crate::combine::robust::{median, trimmed_mean};
use crate::combine::source::{WeightSource, WeightsInMemory};
use zk0_circuits::{Digest, QuantisedWeights, WeightsDigest};
use zk0_protocol::rules::network_rules::Strategy;
use zk0_weights::{BuiltFile, Format, Unread};

/// New global weights: the file, and the digest for the ledger.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Global {
    /// The canonical file.
    pub file: Vec<u8>,
    /// Its digests.
    pub digest: WeightsDigest,
    /// SHA-256 of the new moments, if the strategy has some.
    pub moments: Option<Digest>,
}

/// A strategy's result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AggregationResult {
    /// The file of the new weights.
    pub file: BuiltFile,
    /// SHA-256 of the new moments, if the strategy has some.
    pub moments: Option<Digest>,
}

/// Combines weights, in any order, to the file of new ones. `unread` is the base's unread part, `bases` are what the strategy
/// reads, and `moments` are for a strategy that has some.
pub fn combined(
    format: &Format,
    given: &[WeightedContribution<'_>],
    strategy: Strategy,
    bases: &Bases,
    unread: &Unread,
    moments: &mut Moments<'_>,
) -> Result<AggregationResult, CombineError> {
    let given = &aligned(format, given)?[..];
    let base = in_memory(format, &bases.base);
    let earlier = in_memory(format, &bases.earlier);
    let base = base.as_ref().ok_or(CombineError::NoBase);
    let file = match strategy {
        Strategy::FedAvg => file(format, &average(given)?, unread, None),
        Strategy::Scaffold(_) => file(format, &mean(given)?, unread, None),
        Strategy::Median => file(format, &median(given), unread, None),
        Strategy::TrimmedMean { trim_bps } => {
            file(format, &trimmed_mean(given, trim_bps), unread, None)
        }
        Strategy::Krum { byzantine_bps } => {
            file(format, &krum(format, given, byzantine_bps)?, unread, None)
        }
        Strategy::MultiKrum {
            byzantine_bps,
            keep_bps,
        } => {
            let best = multi_krum(format, given, byzantine_bps, keep_bps)?;
            file(format, &best, unread, None)
        }
        Strategy::NormClipping { max_norm_bps } => {
            let mean = clipped_mean(format, given, base?, max_norm_bps)?;
            file(format, &mean, unread, None)
        }
        Strategy::FedAvgM {
            server_rate_bps,
            momentum_bps,
        } => {
            let earlier = earlier.as_ref().map(|earlier| earlier as &dyn WeightSource);
            let moved = with_momentum(given, base?, earlier, server_rate_bps, momentum_bps)?;
            file(format, &moved, unread, None)
        }
        Strategy::FedAdam {
            server_rate_billionths,
            beta1_bps,
            beta2_bps,
            tau_billionths,
        } => {
            let parameters = AdamParameters {
                server_rate_billionths,
                beta1_bps,
                beta2_bps,
                tau_billionths,
            };
            let moved = adam(given, base?, parameters, moments.steps())?;
            moments.begin(format)?;
            let file = file(format, &moved, unread, Some(&mut *moments))?;
            return Ok(AggregationResult {
                file,
                moments: Some(moments.finish()?),
            });
        }
    };
    Ok(AggregationResult {
        file: file?,
        moments: None,
    })
}

/// Base weights, if given and of this format.
fn in_memory<'a>(
    format: &'a Format,
    weights: &'a Option<QuantisedWeights>,
) -> Option<WeightsInMemory<'a>> {
    let weights = weights.as_ref().filter(|weights| format.fits(weights))?;
    Some(WeightsInMemory { format, weights })
}
