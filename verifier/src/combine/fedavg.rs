//! Federated averaging (McMahan et al., 2017, arXiv:1602.05629).
//!
//! For each weight, the sum of the values, each times its contribution's weight, is divided once by the sum of those weights. The
//! integers are exact, so the order does not matter.

use crate::combine::contributions::WeightedContribution;
use crate::combine::error::CombineError;
use crate::combine::linear::{LinearCombination, ScaledWeights};

/// The weighted mean.
pub fn average<'a>(
    given: &[WeightedContribution<'a>],
) -> Result<LinearCombination<'a>, CombineError> {
    let terms = given.iter().map(|one| ScaledWeights {
        coefficient: one.weight.into(),
        weights: one.weights,
    });
    Ok(LinearCombination::new(terms, whole(given)?))
}

/// The mean with equal weights.
pub fn mean<'a>(given: &[WeightedContribution<'a>]) -> Result<LinearCombination<'a>, CombineError> {
    let alike = |one: &WeightedContribution<'a>| WeightedContribution { weight: 1, ..*one };
    average(&given.iter().map(alike).collect::<Vec<_>>())
}

/// The contributions' total weight, at least 1.
pub(crate) fn whole(given: &[WeightedContribution<'_>]) -> Result<i128, CombineError> {
    match given.iter().map(|one| i128::from(one.weight)).sum() {
        0 => Err(CombineError::Empty),
        whole => Ok(whole),
    }
}
