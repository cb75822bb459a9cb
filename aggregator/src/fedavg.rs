//! Federated averaging (McMahan et al., 2017, arXiv:1602.05629), bit-exact on every machine and for every order of input.
//!
//! For each parameter: products of weight and value are summed in IEEE 754 double precision, in ascending order of node
//! identity, divided once by the sum of the weights, and rounded once to float32 (to nearest, ties to even). Nothing is
//! fused or reordered. A float32 times a weight below 2^29 is exact in a double, so one contribution alone averages to
//! itself.

use zk0_circuits::{NodeId, WeightsDigest};
use zk0_ledger::Refusal;
use zk0_verifier::{Evaluation, ExpertTensors, VerifiedContribution, WeightsError};

/// New global weights: as a file and as the digest that goes on the ledger.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Global {
    /// The canonical safetensors file.
    pub file: Vec<u8>,
    /// Its digests.
    pub digest: WeightsDigest,
}

/// Why there is no average.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FedAvgError {
    /// Nothing to average.
    #[error("no contribution has any weight")]
    Empty,
    /// A node twice.
    #[error("node {0} contributes twice")]
    Twice(NodeId),
    /// Contributions that do not fit one another.
    #[error("node {node}'s weights have no tensor '{tensor}' of {len} values")]
    Unlike {
        node: NodeId,
        tensor: String,
        len: usize,
    },
    /// The average is not finite; cannot happen for finite weights.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The average does not quantise.
    #[error("the average has no digest: {0}")]
    Digest(#[from] Refusal),
}

/// Averages verified contributions, weighted by their committed samples as the rules cap them.
pub fn fedavg(
    contributions: &[VerifiedContribution],
    evaluation: &Evaluation,
) -> Result<Global, FedAvgError> {
    let weighted: Vec<_> = contributions
        .iter()
        .map(|one| (one.node(), one.samples(), one.weights()))
        .collect();
    let weights = average(&weighted)?;
    let file = weights.to_bytes();
    let digest = evaluation.digest(&file, &weights)?;
    Ok(Global { file, digest })
}

/// The weighted average of `(node, weight, tensors)`; the order they are given in does not matter.
pub fn average(weighted: &[(NodeId, u64, &ExpertTensors)]) -> Result<ExpertTensors, FedAvgError> {
    let mut weighted: Vec<_> = weighted.to_vec();
    weighted.sort_by_key(|(node, _, _)| *node);
    if let Some(pair) = weighted.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        return Err(FedAvgError::Twice(pair[0].0));
    }
    let total = weighted
        .iter()
        .fold(0.0, |sum, (_, samples, _)| sum + *samples as f64);
    let [(_, _, first), ..] = weighted[..] else {
        return Err(FedAvgError::Empty);
    };
    if total == 0.0 {
        return Err(FedAvgError::Empty);
    }
    for (node, _, tensors) in &weighted {
        let unlike = |(name, _, values): (&str, &[usize], &[f32])| {
            let same = tensors
                .get(name)
                .is_some_and(|own| own.len() == values.len());
            (!same).then(|| FedAvgError::Unlike {
                node: *node,
                tensor: name.to_owned(),
                len: values.len(),
            })
        };
        if let Some(error) = first.iter().find_map(unlike) {
            return Err(error);
        }
    }
    let average = first.map(|name, values| {
        // −0.0 is what adds nothing, to a negative zero either.
        let mut sums = vec![-0.0f64; values.len()];
        for (_, samples, tensors) in &weighted {
            let samples = *samples as f64;
            for (sum, value) in sums.iter_mut().zip(tensors.get(name).unwrap_or_default()) {
                *sum += samples * f64::from(*value);
            }
        }
        sums.into_iter().map(|sum| (sum / total) as f32).collect()
    })?;
    Ok(average)
}
