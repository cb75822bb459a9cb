//! The squared errors of base and update on the evaluated samples, and what counts where the base has none.
//!
//! A base can overflow: a poisoned base has values that fit on the samples of those who poisoned it, and not on those of others. If such
//! a base ended the evaluation, nobody else could make a claim, and the poisoned base would stay. So an overflowing base counts as
//! a great loss, and only an overflowing update ends the evaluation.

use crate::claim::t_test::Pair;
use alloc::vec::Vec;

/// Squared errors on one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Errors {
    /// Under the base weights; `None` if a value overflows.
    pub base: Option<u64>,
    /// Under the update.
    pub update: u64,
}

/// More than any evaluation's squared error: at most 2^36 per element and 2^18 elements are less.
const GREATEST: u64 = 1 << 55;

/// Returns the errors with a number wherever the base overflows.
///
/// There, the base counts as worse than the update by as much as on the sample on which it is worst. A greater number would not help an
/// honest node: one difference far above the others spreads so much that no test could be sure of it. If the base overflows on every
/// sample, it counts as the greatest loss on each.
pub fn pairs(errors: &[Errors]) -> Vec<Pair> {
    let differences = errors
        .iter()
        .filter_map(|one| Some(one.base?.saturating_sub(one.update)));
    let most = differences.max();
    let pair = |one: &Errors| Pair {
        base: match (one.base, most) {
            (Some(base), _) => base,
            (None, Some(most)) => one.update.saturating_add(most),
            (None, None) => GREATEST,
        },
        update: one.update,
    };
    errors.iter().map(pair).collect()
}
