//! LeRobot's path templates: which file holds an episode.

use std::path::{Component, Path, PathBuf};

/// A file of the recording: shared by episodes in v3.0, one per episode in v2.x.
#[derive(Debug, Clone, Copy)]
pub(crate) enum RecordingFile {
    /// `chunk-{chunk}/file-{file}`.
    Shared { chunk: u64, file: u64 },
    /// `chunk-{chunk}/episode_{episode}`.
    OfEpisode { chunk: u64, episode: u64 },
}

/// Fills LeRobot's path template, a Python format; the result stays inside the dataset's folder.
pub(crate) fn fill(template: &str, camera: &str, place: RecordingFile) -> Result<PathBuf, String> {
    let path = filled(template, camera, place).filter(|path| {
        let mut parts = Path::new(path).components();
        let inside = |part| matches!(part, Component::Normal(_) | Component::CurDir);
        !path.is_empty() && parts.all(inside)
    });
    match path {
        Some(path) => Ok(path.into()),
        None => Err(format!(
            "path template {template:?} is not one that can be followed"
        )),
    }
}

fn filled(template: &str, camera: &str, place: RecordingFile) -> Option<String> {
    let (mut path, mut rest) = (String::new(), template);
    while let Some((text, field)) = rest.split_once('{') {
        let (field, after) = field.split_once('}')?;
        let (name, width) = field.split_once(':').unwrap_or((field, ""));
        path.push_str(text);
        match (name, place) {
            ("video_key", _) if width.is_empty() => path.push_str(camera),
            ("chunk_index", RecordingFile::Shared { chunk: number, .. })
            | ("file_index", RecordingFile::Shared { file: number, .. })
            | ("episode_chunk", RecordingFile::OfEpisode { chunk: number, .. })
            | (
                "episode_index",
                RecordingFile::OfEpisode {
                    episode: number, ..
                },
            ) => path.push_str(&with_zeros(number, width)?),
            _ => return None,
        }
        rest = after;
    }
    path.push_str(rest);
    (!rest.contains('}')).then_some(path)
}

/// A number in Python's format `03d`, `d` or none.
fn with_zeros(number: u64, width: &str) -> Option<String> {
    match width.strip_suffix('d').unwrap_or(width) {
        "" => Some(number.to_string()),
        width => {
            let width: usize = width.strip_prefix('0')?.parse().ok()?;
            (width <= 20).then(|| format!("{number:0width$}"))
        }
    }
}
