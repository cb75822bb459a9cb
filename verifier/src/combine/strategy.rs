//! From a round's contributions to new global weights, as the rules say: [`crate::combine::fedavg`], or one of [`crate::combine::robust`].
//!
//! **Where it rounds**: each tensor's exact means are rounded once, to the nearest int16 at the one scale that the means have
//! ([`zk0_weights::scale`]); ties go to even. A mean is no larger than the largest of its values, so it always fits within the
//! scale's limits. Where the evaluation does not read, the result has the numbers of the round's base ([`zk0_weights::unread`]).

use crate::combine::contributions::{aligned, CombineError, Fractions, Given, Part};
use crate::combine::fedavg::average;
use crate::combine::robust::{median, trimmed_mean};
use crate::contribution::VerifiedContribution;
use crate::update::Evaluation;
use zk0_circuits::{QuantisedWeights, WeightsDigest};
use zk0_protocol::entries::entry::Contributor;
use zk0_protocol::rules::network_rules::Strategy;
use zk0_weights::scale::narrowed;
use zk0_weights::{Format, Unread};

/// New global weights: as a file and as the digest that goes on the ledger.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Global {
    /// The canonical file.
    pub file: Vec<u8>,
    /// Its digests.
    pub digest: WeightsDigest,
}

/// Combines verified contributions to one round, all of which started from the same base. They count by the shares of `contributors`.
pub fn combine(
    contributions: &[VerifiedContribution],
    contributors: &[Contributor],
    strategy: Strategy,
    evaluation: &Evaluation,
) -> Result<Global, CombineError> {
    let given: Vec<_> = contributions
        .iter()
        .map(|one| {
            let mut all = contributors.iter();
            let share = all.find(|other| other.node == one.node());
            let share = share.map_or(0, |contributor| contributor.share);
            (one.node(), u64::from(share), one.weights())
        })
        .collect();
    let unread = contributions.first().ok_or(CombineError::Empty)?.unread();
    let weights = combined(evaluation.format(), &given, strategy, unread)?;
    let file = evaluation.format().write(&weights);
    let digest = evaluation.digest(&file, &weights);
    Ok(Global { file, digest })
}

/// Combines weights, one tensor at a time. The order they are given in does not matter. `unread` is what their base holds where the
/// evaluation does not read.
pub fn combined(
    format: &Format,
    given: &[Given<'_>],
    strategy: Strategy,
    unread: &Unread,
) -> Result<QuantisedWeights, CombineError> {
    let given = aligned(format, given)?;
    format.assemble(|index| {
        let parts: Vec<_> = given
            .iter()
            .map(|(_, weight, weights)| {
                let (values, bits) = format.tensor(weights, index);
                Part {
                    weight: *weight,
                    values,
                    bits,
                }
            })
            .collect();
        let Fractions {
            mut numerators,
            divisor,
        } = match strategy {
            Strategy::FedAvg => average(&parts),
            Strategy::Median => median(&parts),
            Strategy::TrimmedMean { trim_bps } => trimmed_mean(&parts, trim_bps),
        }?;
        unread.restore(index, &mut numerators, divisor);
        Ok(narrowed(&numerators, divisor, format.limits()[index]))
    })
}
