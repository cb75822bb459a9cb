//! The statistics of a recording.

use std::collections::HashMap;
use std::path::Path;

use crate::dataset::metadata::episode_stats;
use crate::dataset::metadata::info::{FormatVersion, ACTION, STATE};
use crate::dataset::metadata::json::{self, read_text};
use crate::dataset::metadata::normalizer::{MeanAndStd, Normalizer, Stats};
use crate::dataset::{DatasetError, Episode, Info};

/// From `meta/stats.json`, or in v2.1 the episodes', pooled.
pub(crate) fn read(root: &Path, info: &Info, episodes: &[Episode]) -> Result<Stats, DatasetError> {
    if info.format == FormatVersion::V21 {
        episode_stats::read(root, info, episodes)
    } else {
        read_whole(root, info)
    }
}

fn read_whole(root: &Path, info: &Info) -> Result<Stats, DatasetError> {
    let path = root.join("meta/stats.json");
    let text = read_text(&path)?;
    let broken = |cause: String| DatasetError::meta(&path, cause);
    // Statistics of images are nested differently, and not used.
    let mut all: HashMap<String, serde_json::Value> =
        json::parse(&text).map_err(|e| broken(format!("is not the JSON it should be: {e}")))?;
    let mut normalizer = |name: &str, dim: usize| {
        let value = all
            .remove(name)
            .ok_or_else(|| broken(format!("has no statistics of {name}")))?;
        let moments: MeanAndStd =
            serde_json::from_value(value).map_err(|e| broken(format!("{name}: {e}")))?;
        Normalizer::of(&moments, dim).map_err(|cause| broken(format!("{name}: {cause}")))
    };
    Ok(Stats {
        state: normalizer(STATE, info.state.dim)?,
        action: normalizer(ACTION, info.action.dim)?,
    })
}
