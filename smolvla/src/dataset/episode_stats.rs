//! `meta/episodes_stats.jsonl` of v2.1: moments of every episode, pooled into those of the recording as LeRobot's
//! `aggregate_stats` does it.
//!
//! With n frames in an episode of mean m and standard deviation s, and M the mean over all frames:
//! M = sum(n m) / sum(n), and the variance is sum(n (s² + (m - M)²)) / sum(n).

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::info::{ACTION, STATE};
use super::json;
use super::stats::{Moments, Normalizer};
use super::{DatasetError, Info, Stats};

#[derive(Deserialize)]
struct Line {
    episode_index: usize,
    stats: EpisodeStats,
}

/// The features that are normalised; the others' statistics are not read.
#[derive(Deserialize)]
struct EpisodeStats {
    #[serde(rename = "observation.state")]
    state: FeatureStats,
    action: FeatureStats,
}

#[derive(Deserialize)]
struct FeatureStats {
    #[serde(flatten)]
    moments: Moments,
    /// Frames, as a list of one number.
    count: Vec<f64>,
}

/// Reads all episodes' statistics; every episode has to be there.
pub(super) fn read(root: &Path, info: &Info) -> Result<Stats, DatasetError> {
    let path = root.join("meta/episodes_stats.jsonl");
    // LeRobot adds up in the order of the episodes, and takes the last line where an episode has several.
    let mut lines: BTreeMap<usize, EpisodeStats> = BTreeMap::new();
    json::read_lines(&path, |number, line: Line| {
        let wrong = |cause: String| DatasetError::meta(&path, format!("line {number}: {cause}"));
        if line.episode_index >= info.total_episodes {
            return Err(wrong(format!(
                "episode {} where meta/info.json declares {} episodes",
                line.episode_index, info.total_episodes
            )));
        }
        for (name, stats, dim) in [
            (STATE, &line.stats.state, info.state.dim),
            (ACTION, &line.stats.action, info.action.dim),
        ] {
            stats
                .check(dim)
                .map_err(|cause| wrong(format!("{name}: {cause}")))?;
        }
        lines.insert(line.episode_index, line.stats);
        Ok(())
    })?;
    if lines.len() != info.total_episodes {
        return Err(DatasetError::meta(
            path,
            format!(
                "has statistics of {} episodes, meta/info.json declares {}",
                lines.len(),
                info.total_episodes
            ),
        ));
    }
    let pooled = |name: &str, dim: usize, of: fn(&EpisodeStats) -> &FeatureStats| {
        let all: Vec<&FeatureStats> = lines.values().map(of).collect();
        Normalizer::of(&pool(&all, dim), dim)
            .map_err(|cause| DatasetError::meta(&path, format!("{name}: {cause}")))
    };
    Ok(Stats {
        state: pooled(STATE, info.state.dim, |s| &s.state)?,
        action: pooled(ACTION, info.action.dim, |s| &s.action)?,
    })
}

impl FeatureStats {
    fn check(&self, dim: usize) -> Result<(), String> {
        let expected = "expected a list of one number of frames";
        match self.count[..] {
            [count] if count >= 1.0 && count.is_finite() => {}
            [count] => return Err(format!("count is [{count:?}], {expected}")),
            _ => {
                let found = self.count.len();
                return Err(format!("count is a list of {found} numbers, {expected}"));
            }
        }
        Normalizer::of(&self.moments, dim).map(|_| ())
    }
}

/// Moments of all frames together; every entry has `dim` dimensions and a count.
fn pool(episodes: &[&FeatureStats], dim: usize) -> Moments {
    let total: f64 = episodes.iter().map(|e| e.count[0]).sum();
    let weighted = |value: &dyn Fn(&Moments) -> f64| {
        episodes
            .iter()
            .map(|e| value(&e.moments) * e.count[0])
            .sum::<f64>()
            / total
    };
    let mean: Vec<f64> = (0..dim).map(|d| weighted(&|m| m.mean[d])).collect();
    let variance = |d: usize| {
        let spread = |m: &Moments| m.std[d].powi(2) + (m.mean[d] - mean[d]).powi(2);
        weighted(&spread)
    };
    let std = (0..dim).map(|d| variance(d).sqrt()).collect();
    Moments { mean, std }
}
