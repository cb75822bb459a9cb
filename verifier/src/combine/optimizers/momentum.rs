//! FedAvgM: federated averaging with momentum (Hsu et al., 2019, arXiv:1909.06335).
//!
//! With the base x of this round, the mean m of its updates, the server rate η and the momentum β, the method computes
//! `v ← β·v + (m − x)` and `x ← x + η·v`. The last round's v is its movement divided by η, from x′ to x, both on the ledger. So this
//! round's result is
//!
//! `x + η·(m − x) + β·(x − x′)`
//!
//! and v need not be kept. The movement includes the ledger's rounding. The first round has none, nor has a round whose base a
//! vote restored (`State::earlier_base`). A round that kept its base has not moved. A value too large for a network's
//! scales becomes the largest possible.

use crate::combine::contributions::WeightedContribution;
use crate::combine::error::CombineError;
use crate::combine::fedavg::whole;
use crate::combine::linear::{LinearCombination, ScaledWeights};
use crate::combine::source::WeightSource;
use zk0_protocol::rules::basis_points::BPS;

/// A round's result from `base`. `earlier` is the last round's base, if it counts.
pub fn with_momentum<'a>(
    given: &[WeightedContribution<'a>],
    base: &'a dyn WeightSource,
    earlier: Option<&'a dyn WeightSource>,
    server_rate_bps: u32,
    momentum_bps: u32,
) -> Result<LinearCombination<'a>, CombineError> {
    let whole = whole(given)?;
    let [one, rate, momentum] = [BPS, server_rate_bps, momentum_bps].map(i128::from);
    let mean = given.iter().map(|update| ScaledWeights {
        coefficient: rate * i128::from(update.weight),
        weights: update.weights,
    });
    let (of_base, of_earlier) = match earlier {
        Some(_) => (one - rate + momentum, -momentum),
        None => (one - rate, 0),
    };
    let of_base = ScaledWeights {
        coefficient: whole * of_base,
        weights: base,
    };
    let of_earlier = earlier.map(|weights| ScaledWeights {
        coefficient: whole * of_earlier,
        weights,
    });
    let terms = mean.chain([of_base]).chain(of_earlier);
    Ok(LinearCombination::new(terms, whole * one))
}
