//! How far an update is from its round's base. The rules can bound that, and so a contribution's effect.

use ethnum::U256;
use zk0_circuits::QuantisedWeights;
use zk0_protocol::rules::basis_points::BPS;
use zk0_protocol::{Refusal, RefusalCode};
use zk0_tensors::ReadAt;
use zk0_weights::scale::exact;
use zk0_weights::{Format, WeightsFile};

/// Refuses an update whose difference from `base` has a Euclidean norm above `limit_bps` basis points of the base's.
///
/// The integers are exact. In units of 2^−24 a weight is below 2^39 in magnitude, so the squares of up to 2^47 differences sum to
/// at most 128 bits.
pub fn check_norm<R: ReadAt>(
    format: &Format,
    base: &WeightsFile<'_, R>,
    update: &QuantisedWeights,
    limit_bps: u32,
) -> Result<(), Refusal> {
    let (mut difference, mut norm) = (0u128, 0u128);
    for index in 0..format.tensors().len() {
        let before = base
            .tensor(index)
            .map_err(|error| RefusalCode::MalformedUpdate.because(error))?;
        let (after, bits) = format.tensor(update, index);
        for (value, updated) in before.values.iter().zip(after) {
            let (value, updated) = (exact(*value, before.bits), exact(*updated, bits));
            difference += square(updated - value);
            norm += square(value);
        }
    }
    let limit = u64::from(limit_bps);
    let per_bps = U256::from(u64::from(BPS) * u64::from(BPS));
    // The squares of both norms, in the same unit.
    let (difference, norm) = (U256::from(difference) * per_bps, U256::from(norm));
    if difference <= norm * U256::from(limit * limit) {
        return Ok(());
    }
    let bps = ratio(difference, norm);
    Err(RefusalCode::TooFar { bps, limit }.into())
}

fn square(value: i64) -> u128 {
    let magnitude = u128::from(value.unsigned_abs());
    magnitude * magnitude
}

/// The least integer whose square is at least `difference / norm`; `u64::MAX` if `norm` is 0.
fn ratio(difference: U256, norm: U256) -> u64 {
    let Some(quotient) = (difference + norm)
        .checked_sub(U256::ONE)
        .and_then(|sum| sum.checked_div(norm))
    else {
        return u64::MAX;
    };
    let quotient = u128::try_from(quotient).unwrap_or(u128::MAX);
    let root = quotient.isqrt();
    let root = root + u128::from(root * root < quotient);
    u64::try_from(root).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ratio_is_rounded_up() {
        let of = |difference: u64, norm: u64| ratio(difference.into(), norm.into());
        assert_eq!(of(9, 1), 3);
        assert_eq!(of(10, 1), 4);
        assert_eq!(of(18, 2), 3);
        assert_eq!(of(19, 2), 4);
        assert_eq!(of(1, 1000), 1);
        assert_eq!(of(1, 0), u64::MAX);
        assert_eq!(ratio(U256::MAX >> 1, U256::ONE), u64::MAX);
    }
}
