//! `meta/episodes_stats.jsonl` of v2.1: moments of every episode, pooled as LeRobot's `aggregate_stats` does.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use crate::dataset::metadata::info::{ACTION, STATE};
use crate::dataset::metadata::json;
use crate::dataset::metadata::normalizer::{pool, MeanAndStd, Normalizer};
use crate::dataset::{DatasetError, Episode, Info, Stats};

#[derive(Deserialize)]
struct StatsLine {
    episode_index: usize,
    stats: EpisodeStats,
}

/// Other features' statistics are not read.
#[derive(Deserialize)]
struct EpisodeStats {
    #[serde(rename = "observation.state")]
    state: FeatureStats,
    action: FeatureStats,
}

#[derive(Deserialize)]
struct FeatureStats {
    #[serde(flatten)]
    moments: MeanAndStd,
    /// Frames; by default those of the episode.
    count: Option<CountField>,
}

/// LeRobot writes a list of one number.
#[derive(Deserialize)]
#[serde(untagged)]
enum CountField {
    List(Vec<f64>),
    Number(f64),
}

/// Reads the statistics; every episode must be there.
pub(crate) fn read(root: &Path, info: &Info, episodes: &[Episode]) -> Result<Stats, DatasetError> {
    let path = root.join("meta/episodes_stats.jsonl");
    // LeRobot sums in the order of episodes, and takes an episode's last line.
    let mut lines: BTreeMap<usize, EpisodeStats> = BTreeMap::new();
    json::read_lines(&path, |number, line: StatsLine| {
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
        // Every episode has a line; both are in order.
        let all: Vec<_> = lines
            .values()
            .zip(episodes)
            .map(|(line, episode)| {
                let count = of(line).frames().unwrap_or(episode.frames.len() as f64);
                (&of(line).moments, count)
            })
            .collect();
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
        if let Some(CountField::List(list)) = &self.count {
            if list.len() != 1 {
                let found = list.len();
                return Err(format!("count is a list of {found} numbers, {expected}"));
            }
        }
        match self.frames() {
            Some(count) if count.is_nan() || count < 1.0 => {
                return Err(format!("count is [{count:?}], {expected}"))
            }
            _ => {}
        }
        Normalizer::of(&self.moments, dim).map(|_| ())
    }

    fn frames(&self) -> Option<f64> {
        match self.count.as_ref()? {
            CountField::List(list) => list.first().copied(),
            CountField::Number(count) => Some(*count),
        }
    }
}
