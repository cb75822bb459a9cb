//! How far an update is from the weights that its round started from. The rules can bound that, and so what one contribution can do.

use crate::weights::ExpertTensors;
use zk0_protocol::rules::basis_points::BPS;
use zk0_protocol::Refusal;

/// Refuses an update whose difference from `base` has a Euclidean norm above `limit_bps` basis points of the base's.
///
/// Squares are summed in double precision, tensor by tensor in ascending order of name, so the result is the same on every machine.
pub fn check_norm(
    base: &ExpertTensors,
    update: &ExpertTensors,
    limit_bps: u32,
) -> Result<(), Refusal> {
    let (mut difference, mut norm) = (0f64, 0f64);
    for (name, _, values) in base.iter() {
        let updated = update.get(name).unwrap_or_default();
        for (value, updated) in values.iter().zip(updated) {
            let (value, updated) = (f64::from(*value), f64::from(*updated));
            difference += (updated - value) * (updated - value);
            norm += value * value;
        }
    }
    let share = f64::from(limit_bps) / f64::from(BPS);
    if difference <= share * share * norm {
        return Ok(());
    }
    let bps = (difference / norm).sqrt() * f64::from(BPS);
    Err(Refusal::TooFar {
        // A cast saturates. With a base of zeros the ratio is infinite.
        bps: bps.ceil() as u64,
        limit: limit_bps.into(),
    })
}
