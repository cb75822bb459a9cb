//! LeRobot's path templates: which file of the folder holds an episode.

use std::path::{Component, Path, PathBuf};

/// A file of the recording: v3.0 numbers files that several episodes share, v2.x has one for each episode.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Place {
    /// `chunk-{chunk}/file-{file}`.
    Shared { chunk: u64, file: u64 },
    /// `chunk-{chunk}/episode_{episode}`.
    OfEpisode { chunk: u64, episode: u64 },
}

/// Fills LeRobot's path template; the result stays inside the dataset's folder.
pub(crate) fn fill(template: &str, camera: &str, place: Place) -> Result<PathBuf, String> {
    let path = template.replace("{video_key}", camera);
    let path = match place {
        Place::Shared { chunk, file } => path
            .replace("{chunk_index:03d}", &format!("{chunk:03}"))
            .replace("{file_index:03d}", &format!("{file:03}")),
        Place::OfEpisode { chunk, episode } => path
            .replace("{episode_chunk:03d}", &format!("{chunk:03}"))
            .replace("{episode_index:06d}", &format!("{episode:06}")),
    };
    let inside = Path::new(&path)
        .components()
        .all(|c| matches!(c, Component::Normal(_)));
    if path.is_empty() || path.contains(['{', '}']) || !inside {
        return Err(format!(
            "path template {template:?} is not one that can be followed"
        ));
    }
    Ok(path.into())
}
