//! The contributions to a combination, in their canonical order.

use zk0_circuits::{NodeId, QuantisedWeights};
use zk0_weights::{Format, WeightsError};

/// Why contributions do not combine.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CombineError {
    /// No contribution has a weight above 0.
    #[error("no contribution has any weight")]
    Empty,
    /// A node contributes twice.
    #[error("node {0} contributes twice")]
    Twice(NodeId),
    /// A contribution is of another network's dimensions.
    #[error("node {0}'s weights have another size than those of this network")]
    Unlike(NodeId),
    /// The result is not among the weights that a network can have. The mean of such weights cannot give that.
    #[error(transparent)]
    Weights(#[from] WeightsError),
}

/// A contribution to a combination: node, weight in the average, and what it contributes.
pub type Given<'a> = (NodeId, u64, &'a QuantisedWeights);

/// One tensor of a contribution.
#[derive(Clone, Copy, Debug)]
pub struct Part<'a> {
    /// The contribution's weight in the average.
    pub weight: u64,
    /// The tensor's values, row-major.
    pub values: &'a [i16],
    /// Their fraction bits.
    pub bits: i16,
}

/// Exact numbers: fractions with one divisor, in units of 2^−24.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fractions {
    /// One for each value of a tensor.
    pub numerators: Vec<i128>,
    /// At least 1.
    pub divisor: i128,
}

/// The contributions in ascending order of node, each node once, all of this format.
pub fn aligned<'a>(format: &Format, given: &[Given<'a>]) -> Result<Vec<Given<'a>>, CombineError> {
    let mut given = given.to_vec();
    given.sort_by_key(|(node, _, _)| *node);
    if let Some(pair) = given.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        return Err(CombineError::Twice(pair[0].0));
    }
    match given.iter().find(|(_, _, weights)| !format.fits(weights)) {
        Some((node, _, _)) => Err(CombineError::Unlike(*node)),
        None if given.is_empty() => Err(CombineError::Empty),
        None => Ok(given),
    }
}
