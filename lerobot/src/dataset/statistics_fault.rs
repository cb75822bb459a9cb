//! Statistics that do not fit the rows: rows were added, removed or changed later. A policy would be normalised with numbers of other data.

use std::fmt;
use std::path::PathBuf;

use crate::dataset::metadata::bounds::{self, RecordedBounds};
use crate::dataset::metadata::info::{FormatVersion, ACTION, STATE};
use crate::dataset::tables::spread::Spread;
use crate::dataset::{Dataset, DatasetError, Normalizer, Repair, VectorFeature};

/// A statistic may differ from the rows' by this share of their range: some tools write fewer digits, or divide by one row less.
const OF_RANGE: f64 = 1e-3;

/// It may also differ by this share of the largest value. LeRobot adds rows in float32, which loses at worst 6e-8 of the sum per row: 1e-4
/// in 1,600 rows. Its variance is the mean square less the squared mean, so the same holds for squares.
const OF_LARGEST: f64 = 1e-4;

/// A feature whose statistics do not fit the rows.
#[derive(Debug, Clone, PartialEq)]
pub struct StatisticsFault {
    /// The file that has them.
    pub path: PathBuf,
    /// `observation.state` or `action`.
    pub feature: &'static str,
    /// The first statistic that differs: `count`, `min`, `max`, `mean` or `std`.
    pub statistic: &'static str,
    /// Its joint, by name or number; a count has none.
    pub joint: Option<String>,
    /// What the file states.
    pub written: f64,
    /// What the rows have.
    pub found: f64,
    /// How many numbers differ.
    pub differ: usize,
    root: PathBuf,
    format: FormatVersion,
}

impl Dataset {
    /// Compares the statistics of states and actions with the rows: the normalising mean and standard deviation, and `count`, `min` and
    /// `max` where the file has them. Statistics of relative actions, an option of LeRobot's `recompute_stats`, do not fit the rows.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn statistics_faults(&self) -> Result<Vec<StatisticsFault>, DatasetError> {
        let (path, bounds) = bounds::read(self.root(), self.info())?;
        let (info, stats) = (self.info(), self.stats());
        let features = [
            (STATE, &info.state, &stats.state),
            (ACTION, &info.action, &stats.action),
        ];
        // LeRobot counts repeated rows in the statistics of such files.
        let repeated = self.repairs().iter().map(|repair| match repair {
            Repair::RepeatedRows { rows, .. } => *rows,
            _ => 0,
        });
        let repeated: usize = repeated.sum();
        let faults = features.into_iter().zip(&bounds).zip(&self.spreads);
        let faults = faults.filter_map(|(((name, feature, moments), bounds), rows)| {
            let counts = [rows.rows, rows.rows + repeated];
            let differ = differences(feature, moments, bounds, rows, counts);
            let first = differ.first()?.clone();
            Some(StatisticsFault {
                path: path.clone(),
                feature: name,
                statistic: first.statistic,
                joint: first.joint,
                written: first.written,
                found: first.found,
                differ: differ.len(),
                root: self.root().into(),
                format: info.format,
            })
        });
        Ok(faults.collect())
    }
}

#[derive(Clone)]
struct StatisticDifference {
    statistic: &'static str,
    joint: Option<String>,
    written: f64,
    found: f64,
}

fn differences(
    feature: &VectorFeature,
    moments: &Normalizer,
    bounds: &RecordedBounds,
    rows: &Spread,
    counts: [usize; 2],
) -> Vec<StatisticDifference> {
    let mut differ = Vec::new();
    if let Some(count) = bounds.count {
        if !counts.map(|rows| rows as f64).contains(&count) {
            differ.push(StatisticDifference {
                statistic: "count",
                joint: None,
                written: count,
                found: rows.rows as f64,
            });
        }
    }
    let written = |list: &Option<Vec<f64>>, d: usize| {
        let list = list.as_ref().filter(|list| list.len() == feature.dim);
        list.map(|list| list[d])
    };
    for d in 0..feature.dim {
        let (min, max) = (rows.min[d], rows.max[d]);
        let largest = min.abs().max(max.abs());
        let slack = OF_RANGE * (max - min) + OF_LARGEST * largest;
        let near = |a: f64, b: f64, slack: f64| (a - b).abs() <= slack;
        let (mean, std) = (f64::from(moments.mean()[d]), f64::from(moments.std()[d]));
        let has_std = near(std, rows.std[d], slack)
            || near(
                std.powi(2),
                rows.std[d].powi(2),
                OF_LARGEST * largest.powi(2),
            );
        for (statistic, written, found, fits) in [
            ("min", written(&bounds.min, d), min, None),
            ("max", written(&bounds.max, d), max, None),
            ("mean", Some(mean), rows.mean[d], None),
            ("std", Some(std), rows.std[d], Some(has_std)),
        ] {
            let Some(written) = written else { continue };
            if !fits.unwrap_or_else(|| near(written, found, slack)) {
                let name = feature.names.get(d).cloned();
                differ.push(StatisticDifference {
                    statistic,
                    joint: Some(name.unwrap_or_else(|| format!("dimension {d}"))),
                    written,
                    found,
                });
            }
        }
    }
    differ
}

impl fmt::Display for StatisticsFault {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let (written, found) = (self.written as f32, self.found as f32);
        let (path, root) = (self.path.display(), self.root.display());
        write!(f, "{path}: the {} of {}", self.statistic, self.feature)?;
        if let Some(joint) = &self.joint {
            write!(f, " ({joint})")?;
        }
        write!(f, " is {written}, and the rows have {found}")?;
        if self.differ > 1 {
            write!(f, "; {} numbers of this feature differ", self.differ)?;
        }
        let first = match self.format {
            FormatVersion::V30 => "Compute them anew",
            FormatVersion::V20 | FormatVersion::V21 => {
                "Convert the recording to v3.0 with LeRobot, and compute them anew"
            }
        };
        write!(
            f,
            ". Policies are normalised with the statistics. {first}: lerobot-edit-dataset --repo_id NAME --root {root} --new_root {root} \
             --operation.type recompute_stats --operation.overwrite true"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// LeRobot 0.6.1 (`get_feature_stats`) gives these moments of 300 rows of 100.3.
    #[test]
    fn what_lerobot_loses_in_float32_is_no_fault() {
        let rows = Spread::of(&[100.3; 300], 1);
        let feature = VectorFeature {
            dim: 1,
            names: Vec::new(),
        };
        let differ = |std: f32| {
            let moments = Normalizer::new(vec![100.299_995], vec![std]).unwrap();
            differences(
                &feature,
                &moments,
                &RecordedBounds::default(),
                &rows,
                [300; 2],
            )
        };
        assert!(differ(0.044_194_173).is_empty());
        let found = differ(2.0);
        assert_eq!((found.len(), found[0].statistic), (1, "std"));
        assert_eq!(found[0].joint.as_deref(), Some("dimension 0"));
    }
}
