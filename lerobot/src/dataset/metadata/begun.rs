//! A recording without a finished episode. LeRobot writes `meta/info.json` first, and the rest with the first episode: tasks, rows, videos,
//! then the number of episodes.

use std::path::Path;

use serde_json::Value;

use crate::dataset::metadata::json::{self, read_text};
use crate::dataset::tables::parquet_files::parquet_files;
use crate::dataset::DatasetError;

/// The fault of the recording in `root`, if `info.json` counts no episode.
pub(crate) fn fault(root: &Path, info: &str) -> Option<DatasetError> {
    let info: Value = json::parse(info).ok()?;
    let is_zero = |name: &str| info.get(name).and_then(Value::as_f64) == Some(0.0);
    if !is_zero("total_episodes") || !is_zero("total_frames") {
        return None;
    }
    let files = parquet_files(&root.join("data")).unwrap_or_default();
    let Some(rows) = files.first() else {
        return Some(DatasetError::NothingFinished { path: root.into() });
    };
    // The first episode was being saved.
    let is_v30 = info.get("codebase_version").and_then(Value::as_str) == Some("v3.0");
    is_v30.then(|| DatasetError::Unfinished {
        path: root.into(),
        sign: format!(
            "meta/info.json counts no episode, and {} is there",
            rows.display()
        ),
    })
}

/// Refuses a recording with neither finished episode nor rows: the file was never written.
pub(crate) fn refuse_empty(root: &Path) -> Result<(), DatasetError> {
    let info = read_text(&root.join("meta/info.json"))?;
    match fault(root, &info) {
        Some(error @ DatasetError::NothingFinished { .. }) => Err(error),
        _ => Ok(()),
    }
}
