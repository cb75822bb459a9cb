//! Output of `zk0 fidelity`: JSON lines to standard output, tables to standard error.

use crate::output::{eprintln, println};
use serde::Serialize;
use zk0_smolvla::measure::calibrate::ObservedRange;
use zk0_smolvla::measure::fidelity::{Fidelity, FidelityError};

/// One comparison.
#[derive(Clone, Debug, Serialize)]
pub struct ComparisonRow {
    /// Name of the policy.
    pub policy: String,
    /// `untrained` or `trained`.
    pub weights: &'static str,
    /// `default` or `calibrated`.
    pub ranges: &'static str,
    /// The outcome.
    #[serde(flatten)]
    pub outcome: ComparisonOutcome,
}

/// The outcome of a comparison.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum ComparisonOutcome {
    /// Losses, differences as fractions, and the least headroom as a factor.
    Compared {
        samples: usize,
        float32_loss: f64,
        fixed_point_loss: f64,
        relative_difference: f64,
        worst_sample: f64,
        least_headroom: f64,
        least_headroom_at: String,
    },
    /// A value exceeds its range. The error names the place.
    Failed { error: String },
}

#[derive(Serialize)]
struct RangeLine<'a> {
    policy: &'a str,
    weights: &'a str,
    ranges: &'a str,
    place: String,
    largest: f32,
    holds: f64,
    headroom: f64,
}

impl ComparisonOutcome {
    /// From a measurement that succeeded or failed.
    pub fn of(measured: &Result<Fidelity, FidelityError>) -> Self {
        let fidelity = match measured {
            Ok(fidelity) => fidelity,
            Err(error) => {
                let error = error.to_string();
                return Self::Failed { error };
            }
        };
        let tightest = fidelity.tightest();
        Self::Compared {
            samples: fidelity.evaluations,
            float32_loss: fidelity.float32_loss,
            fixed_point_loss: fidelity.fixed_point_loss,
            relative_difference: fidelity.relative_difference(),
            worst_sample: fidelity.worst_sample,
            least_headroom: tightest.map_or(f64::INFINITY, ObservedRange::headroom),
            least_headroom_at: tightest.map_or(String::new(), |range| range.place.to_string()),
        }
    }

    /// Whether the mean losses differ by at most `limit`, a fraction.
    pub fn is_within(&self, limit: f64) -> bool {
        match self {
            Self::Compared {
                relative_difference,
                ..
            } => *relative_difference <= limit,
            Self::Failed { .. } => false,
        }
    }
}

/// Prints a JSON line for each place to standard output, and each kind's tightest layer to standard error.
pub fn print_ranges(row: &ComparisonRow, ranges: &[ObservedRange]) -> serde_json::Result<()> {
    let mut kinds: Vec<(String, ObservedRange)> = Vec::new();
    for range in ranges {
        let place = range.place.to_string();
        let line = RangeLine {
            policy: &row.policy,
            weights: row.weights,
            ranges: row.ranges,
            place: place.clone(),
            largest: range.largest,
            holds: range.holds,
            headroom: range.headroom(),
        };
        println!("{}", serde_json::to_string(&line)?);
        let kind = match place.strip_prefix("layer ") {
            Some(place) => place.trim_start_matches(|c: char| c.is_ascii_digit() || c == ' '),
            None => &place,
        };
        match kinds.iter_mut().find(|(known, _)| known == kind) {
            Some((_, tightest)) if tightest.headroom() <= range.headroom() => {}
            Some((_, tightest)) => *tightest = *range,
            None => kinds.push((kind.into(), *range)),
        }
    }
    eprintln!("{}, {}, {} ranges", row.policy, row.weights, row.ranges);
    eprintln!(
        "{:<44} {:>10} {:>10} {:>9}",
        "tightest", "largest", "holds", "headroom"
    );
    for (_, range) in kinds {
        eprintln!(
            "{:<44} {:>10.4} {:>10.4} {:>9.1}",
            range.place.to_string(),
            range.largest,
            range.holds,
            range.headroom()
        );
    }
    Ok(())
}

/// A table of all rows.
pub fn table(rows: &[ComparisonRow]) -> String {
    let mut text = format!(
        "{:<13} {:<9} {:<10} {:>7} {:>9} {:>11} {:>10} {:>12}  {}\n",
        "policy",
        "weights",
        "ranges",
        "samples",
        "float32",
        "fixed point",
        "difference",
        "worst sample",
        "least headroom"
    );
    for row in rows {
        let ComparisonRow {
            policy,
            weights,
            ranges,
            ..
        } = row;
        text += &format!("{policy:<13} {weights:<9} {ranges:<10} ");
        text += &match &row.outcome {
            ComparisonOutcome::Failed { error } => format!("failed: {error}\n"),
            ComparisonOutcome::Compared {
                samples,
                float32_loss,
                fixed_point_loss,
                relative_difference,
                worst_sample,
                least_headroom,
                least_headroom_at,
            } => format!(
                "{samples:>7} {float32_loss:>9.5} {fixed_point_loss:>11.5} {:>8.4} % {:>10.4} %  {least_headroom:.1} at {least_headroom_at}\n",
                100.0 * relative_difference,
                100.0 * worst_sample
            ),
        };
    }
    text
}
