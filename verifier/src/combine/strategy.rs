//! From a round's contributions to new global weights, as the rules say: [`crate::combine::fedavg`], or one of [`crate::combine::robust`].

use crate::combine::contributions::CombineError;
use crate::combine::fedavg::average;
use crate::combine::robust::{median, trimmed_mean};
use crate::contribution::VerifiedContribution;
use crate::update::Evaluation;
use zk0_circuits::WeightsDigest;
use zk0_protocol::rules::network_rules::Strategy;

/// New global weights: as a file and as the digest that goes on the ledger.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Global {
    /// The canonical safetensors file.
    pub file: Vec<u8>,
    /// Its digests.
    pub digest: WeightsDigest,
}

/// Combines verified contributions.
pub fn combine(
    contributions: &[VerifiedContribution],
    strategy: Strategy,
    evaluation: &Evaluation,
) -> Result<Global, CombineError> {
    let given: Vec<_> = contributions
        .iter()
        .map(|one| (one.node(), one.samples(), one.weights()))
        .collect();
    let weights = match strategy {
        Strategy::FedAvg => average(&given),
        Strategy::Median => median(&given),
        Strategy::TrimmedMean { trim_bps } => trimmed_mean(&given, trim_bps),
    }?;
    let file = weights.to_bytes();
    let digest = evaluation.digest(&file, &weights)?;
    Ok(Global { file, digest })
}
