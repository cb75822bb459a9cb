//! Statistics besides mean and standard deviation: minimum, maximum and count. They normalise nothing, so they may be missing.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::Value;

use crate::dataset::metadata::info::{FormatVersion, ACTION, STATE};
use crate::dataset::metadata::json::{self, read_text};
use crate::dataset::{DatasetError, Info};

/// Of one feature; `None` where the file lacks it.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct RecordedBounds {
    pub min: Option<Vec<f64>>,
    pub max: Option<Vec<f64>>,
    pub count: Option<f64>,
}

/// Of states and actions, after their file; in v2.1 pooled over episodes.
pub(crate) fn read(
    root: &Path,
    info: &Info,
) -> Result<(PathBuf, [RecordedBounds; 2]), DatasetError> {
    if info.format != FormatVersion::V21 {
        let path = root.join("meta/stats.json");
        let all = json::parse(&read_text(&path)?).map_err(|error| {
            DatasetError::meta(&path, format!("is not the JSON it should be: {error}"))
        })?;
        return Ok((path, of_features(&all)));
    }
    let path = root.join("meta/episodes_stats.jsonl");
    // LeRobot, too, takes an episode's last line.
    let mut episodes = BTreeMap::new();
    json::read_lines(&path, |_, line: Line| {
        if line.episode_index < info.total_episodes {
            episodes.insert(line.episode_index, of_features(&line.stats));
        }
        Ok(())
    })?;
    let pooled = episodes.into_values().reduce(|[states, actions], next| {
        let [more_states, more_actions] = next;
        [states.and(more_states), actions.and(more_actions)]
    });
    Ok((path, pooled.unwrap_or_default()))
}

#[derive(Deserialize)]
struct Line {
    episode_index: usize,
    stats: HashMap<String, Value>,
}

fn of_features(all: &HashMap<String, Value>) -> [RecordedBounds; 2] {
    [STATE, ACTION].map(|name| all.get(name).map(RecordedBounds::of).unwrap_or_default())
}

impl RecordedBounds {
    fn of(statistics: &Value) -> Self {
        let list = |name: &str| json::numbers(statistics.get(name)?).ok();
        Self {
            min: list("min"),
            max: list("max"),
            count: list("count").and_then(|count| count.first().copied()),
        }
    }

    fn and(self, other: Self) -> Self {
        Self {
            min: each(self.min, other.min, f64::min),
            max: each(self.max, other.max, f64::max),
            count: self.count.zip(other.count).map(|(a, b)| a + b),
        }
    }
}

fn each(a: Option<Vec<f64>>, b: Option<Vec<f64>>, of: fn(f64, f64) -> f64) -> Option<Vec<f64>> {
    let (a, b) = a.zip(b).filter(|(a, b)| a.len() == b.len())?;
    Some(a.into_iter().zip(b).map(|(a, b)| of(a, b)).collect())
}
