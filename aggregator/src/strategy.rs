//! From a round's contributions to new global weights, as the rules say: [`crate::fedavg`], or one of [`crate::robust`].

use crate::{
    fedavg::average,
    robust::{median, trimmed_mean},
};
use zk0_circuits::{NodeId, WeightsDigest};
use zk0_ledger::{rules::Strategy, Refusal};
use zk0_verifier::{Evaluation, ExpertTensors, VerifiedContribution, WeightsError};

/// New global weights: as a file and as the digest that goes on the ledger.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Global {
    /// The canonical safetensors file.
    pub file: Vec<u8>,
    /// Its digests.
    pub digest: WeightsDigest,
}

/// Why contributions do not combine.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CombineError {
    /// Nothing to combine.
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
    /// The result is not finite; cannot happen for finite weights.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The result does not quantise.
    #[error("the new weights have no digest: {0}")]
    Digest(#[from] Refusal),
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

/// A contribution to a combination: node, weight, tensors.
type Given<'a> = (NodeId, u64, &'a ExpertTensors);

/// The contributions in ascending order of node, each node once, all with the same tensors.
pub(crate) fn aligned<'a>(given: &[Given<'a>]) -> Result<Vec<Given<'a>>, CombineError> {
    let mut given = given.to_vec();
    given.sort_by_key(|(node, _, _)| *node);
    if let Some(pair) = given.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        return Err(CombineError::Twice(pair[0].0));
    }
    let Some((_, _, first)) = given.first() else {
        return Ok(given);
    };
    for (node, _, tensors) in &given {
        let unlike = |(name, _, values): (&str, &[usize], &[f32])| {
            let same = tensors
                .get(name)
                .is_some_and(|own| own.len() == values.len());
            (!same).then(|| CombineError::Unlike {
                node: *node,
                tensor: name.to_owned(),
                len: values.len(),
            })
        };
        if let Some(error) = first.iter().find_map(unlike) {
            return Err(error);
        }
    }
    Ok(given)
}
