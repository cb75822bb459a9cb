//! The contributions to a combination, in their canonical order.

use crate::weights::{ExpertTensors, WeightsError};
use zk0_circuits::NodeId;
use zk0_protocol::Refusal;

/// Why contributions do not combine.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CombineError {
    /// No contribution has a weight above 0.
    #[error("no contribution has any weight")]
    Empty,
    /// A node contributes twice.
    #[error("node {0} contributes twice")]
    Twice(NodeId),
    /// Two contributions have different tensors.
    #[error("node {node}'s weights have no tensor '{tensor}' of {len} values")]
    Unlike {
        node: NodeId,
        tensor: String,
        len: usize,
    },
    /// The result is not finite. Finite weights cannot give that.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The result does not quantise.
    #[error("the new weights have no digest: {0}")]
    Digest(#[from] Refusal),
}

/// A contribution to a combination: node, weight, tensors.
pub type Given<'a> = (NodeId, u64, &'a ExpertTensors);

/// The contributions in ascending order of node, each node once, all with the same tensors.
pub fn aligned<'a>(given: &[Given<'a>]) -> Result<Vec<Given<'a>>, CombineError> {
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
