//! What a camera left in the folder: its videos, single-episode videos not appended yet, and pictures not encoded yet.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use crate::dataset::metadata::info::Camera;
use crate::dataset::recover::placing::VideoFrames;
use crate::dataset::video::mp4::track::Mp4Track;
use crate::dataset::DatasetError;

#[derive(Debug, Clone)]
pub(crate) struct Video {
    pub path: PathBuf,
    pub frames: VideoFrames,
}

/// The camera's videos in order, `videos/CAMERA/chunk-*/file-*.mp4`, up to the first unreadable one, and its fault.
pub(crate) fn videos(
    root: &Path,
    camera: &Camera,
) -> Result<(Vec<Video>, Option<DatasetError>), DatasetError> {
    let mut videos = Vec::new();
    for path in numbered_files(&root.join("videos").join(&camera.name), "mp4")? {
        match open(path, camera) {
            Ok(video) => videos.push(video),
            Err(error) => return Ok((videos, Some(error))),
        }
    }
    Ok((videos, None))
}

/// A one-episode video in LeRobot's temporary folders.
#[derive(Debug)]
pub(crate) struct SingleVideo {
    /// The episode, if encoded from pictures. A video encoded while recording has no number.
    pub episode: Option<u64>,
    /// A killed process may not have written the video's index.
    pub video: Result<Video, DatasetError>,
}

/// The camera's videos in LeRobot's temporary folders beside `meta`.
pub(crate) fn single_videos(
    root: &Path,
    camera: &Camera,
) -> Result<Vec<SingleVideo>, DatasetError> {
    let mut found = Vec::new();
    for folder in entries(root)? {
        let is_temporary = name(&folder).starts_with("tmp") && folder.is_dir();
        if !is_temporary {
            continue;
        }
        for path in entries(&folder)? {
            let Some(rest) = name(&path).strip_prefix(&format!("{}_", camera.name)) else {
                continue;
            };
            let episode = match rest.strip_suffix(".mp4") {
                Some("streaming") => None,
                Some(number) => match number.parse() {
                    Ok(number) => Some(number),
                    Err(_) => continue,
                },
                None => continue,
            };
            let video = open(path, camera);
            found.push(SingleVideo { episode, video });
        }
    }
    Ok(found)
}

/// An episode's pictures not encoded yet, in order: `images/CAMERA/episode-*/frame-*.png`. Empty where one in between is missing.
pub(crate) fn pictures(
    root: &Path,
    camera: &Camera,
    episode: u64,
) -> Result<Vec<PathBuf>, DatasetError> {
    let folder = root.join(format!("images/{}/episode-{episode:06}", camera.name));
    let mut pictures = Vec::new();
    for path in entries(&folder)? {
        if path.extension().is_some_and(|e| e == "png") {
            if name(&path) != format!("frame-{:06}.png", pictures.len()) {
                return Ok(Vec::new());
            }
            pictures.push(path);
        }
    }
    Ok(pictures)
}

pub(crate) fn episodes_with_pictures(root: &Path, camera: &str) -> Result<Vec<u64>, DatasetError> {
    let folders = entries(&root.join("images").join(camera))?;
    let number = |path: &PathBuf| name(path).strip_prefix("episode-")?.parse().ok();
    Ok(folders.iter().filter_map(number).collect())
}

/// `chunk-*/file-*.EXTENSION` in a folder, by name.
pub(crate) fn numbered_files(folder: &Path, extension: &str) -> Result<Vec<PathBuf>, DatasetError> {
    let mut files = Vec::new();
    for chunk in entries(folder)? {
        if name(&chunk).starts_with("chunk-") {
            let of_kind = |path: &PathBuf| {
                name(path).starts_with("file-") && path.extension().is_some_and(|e| e == extension)
            };
            files.extend(entries(&chunk)?.into_iter().filter(of_kind));
        }
    }
    Ok(files)
}

/// A folder's entries by name; empty where there is no folder.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, DatasetError> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(|e| DatasetError::io(folder, e))? {
        let path = entry.map_err(|e| DatasetError::io(folder, e))?.path();
        if path.is_file() || path.is_dir() {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

fn name(path: &Path) -> &str {
    path.file_name()
        .and_then(|name| name.to_str())
        .unwrap_or("")
}

fn open(path: PathBuf, camera: &Camera) -> Result<Video, DatasetError> {
    let mut file = File::open(&path).map_err(|e| DatasetError::io(&path, e))?;
    let track = Mp4Track::read(&mut file).map_err(|cause| DatasetError::video(&path, cause))?;
    if (track.height, track.width) != (camera.height, camera.width) {
        let cause = format!(
            "pictures are {} x {} (height x width), meta/info.json states {} x {}",
            track.height, track.width, camera.height, camera.width
        );
        return Err(DatasetError::video(path, cause));
    }
    let samples = || track.order.iter().map(|&at| &track.samples[at as usize]);
    let frames = VideoFrames {
        times: samples().map(|sample| sample.time).collect(),
        keys: samples().map(|sample| sample.key).collect(),
    };
    Ok(Video { path, frames })
}
