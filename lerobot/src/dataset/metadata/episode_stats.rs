//! `meta/episodes_stats.jsonl` of v2.1: moments of every episode, pooled into those of the recording as LeRobot's
//! `aggregate_stats` does it.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use crate::dataset::metadata::info::{ACTION, STATE};
use crate::dataset::metadata::json;
use crate::dataset::metadata::normalizer::{pool, Moments, Normalizer};
use crate::dataset::{DatasetError, Info, Stats};

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
pub(crate) fn read(root: &Path, info: &Info) -> Result<Stats, DatasetError> {
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
        let all: Vec<_> = lines
            .values()
            .map(|line| (&of(line).moments, of(line).count[0]))
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
