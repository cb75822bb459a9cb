//! The contributions in canonical order.

use crate::combine::error::CombineError;
use crate::combine::source::WeightSource;
use zk0_circuits::NodeId;
use zk0_weights::Format;

/// A contribution to a combination.
#[derive(Clone, Copy)]
pub struct WeightedContribution<'a> {
    /// The contributor.
    pub node: NodeId,
    /// Its weight in an average by shares.
    pub weight: u64,
    /// The weights.
    pub weights: &'a dyn WeightSource,
}

/// The contributions by ascending node, each node once, all of this format.
pub fn aligned<'a>(
    format: &Format,
    given: &[WeightedContribution<'a>],
) -> Result<Vec<WeightedContribution<'a>>, CombineError> {
    let mut given = given.to_vec();
    given.sort_by_key(|one| one.node);
    if let Some(pair) = given.windows(2).find(|pair| pair[0].node == pair[1].node) {
        return Err(CombineError::Twice(pair[0].node));
    }
    match given.iter().find(|one| !one.weights.fits(format)) {
        Some(one) => Err(CombineError::Unlike(one.node)),
        None if given.is_empty() => Err(CombineError::Empty),
        None => Ok(given),
    }
}
