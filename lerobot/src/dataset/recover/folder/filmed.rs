//! The videos, and the statistics of their pictures.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use crate::dataset::metadata::info::Camera;
use crate::dataset::recover::folder::recording::{
    place, EpisodeToWrite, Recording, VideoToWrite, VIDEO_PATH,
};
use crate::dataset::recover::statistics::columns::Statistics;
use crate::dataset::recover::statistics::levels::Levels;
use crate::dataset::recover::statistics::sampling::sampled_frames;
use crate::dataset::tables::motion::TOLERANCE;
use crate::dataset::video::reader::VideoReader;
use crate::dataset::DatasetError;

#[derive(Default)]
pub(super) struct WrittenVideos {
    /// Per episode, statistics of its pictures by camera.
    pub statistics: Vec<BTreeMap<String, Statistics>>,
    /// Cameras without statistics, and why.
    pub notes: Vec<String>,
}

pub(super) fn write_videos(
    recording: &Recording,
    folder: &Path,
) -> Result<WrittenVideos, DatasetError> {
    let mut written = WrittenVideos {
        statistics: vec![BTreeMap::new(); recording.episodes.len()],
        notes: Vec::new(),
    };
    for (at, (camera, videos)) in recording.videos.iter().enumerate() {
        let mut paths = Vec::with_capacity(videos.len());
        for (number, video) in videos.iter().enumerate() {
            let path = place(folder, VIDEO_PATH, &camera.name, number as u64)
                .map_err(|e| DatasetError::write(folder, e))?;
            write_video(video, &path)?;
            paths.push(path);
        }
        match statistics(recording, at, camera, &paths) {
            Ok(statistics) => {
                for (all, of_camera) in written.statistics.iter_mut().zip(statistics) {
                    all.insert(camera.name.clone(), of_camera);
                }
            }
            Err(error) => {
                // The folder has a temporary name.
                let cause = error.to_string();
                let cause = cause.replace(&format!("{}/", folder.display()), "");
                written.notes.push(format!(
                    "there are no statistics of the pictures of {}, without which LeRobot cannot record on in the new folder: {cause}",
                    camera.name
                ));
            }
        }
    }
    Ok(written)
}

fn write_video(video: &VideoToWrite, path: &Path) -> Result<(), DatasetError> {
    let io = |e: io::Error| DatasetError::write(path, e);
    match video {
        VideoToWrite::Copy(from) => {
            let mut from = File::open(from).map_err(|e| DatasetError::io(from, e))?;
            let mut to = File::create_new(path).map_err(io)?;
            io::copy(&mut from, &mut to).map_err(io)?;
        }
        VideoToWrite::Make(make) => make(path)?,
    }
    let written = File::open(path).and_then(|file| file.sync_all());
    written.map_err(io)
}

/// Per episode, statistics of a camera's pictures; `at` counts the cameras that filmed.
fn statistics(
    recording: &Recording,
    at: usize,
    camera: &Camera,
    paths: &[PathBuf],
) -> Result<Vec<Statistics>, DatasetError> {
    let mut open: Option<(usize, VideoReader)> = None;
    let mut of = |episode: &EpisodeToWrite| {
        let (number, from, _) = episode.stretches[at];
        let mut video = match open.take() {
            Some((open, video)) if open == number => video,
            _ => VideoReader::open(&paths[number], camera.height, camera.width)?,
        };
        let mut levels = Levels::new();
        for frame in sampled_frames(episode.len()) {
            let seconds = from + frame as f64 / f64::from(recording.fps);
            let shown = video.frame_at(seconds, TOLERANCE)?;
            levels.add(&video.rgb(shown)?, camera.height, camera.width);
        }
        open = Some((number, video));
        Ok(levels.statistics())
    };
    recording.episodes.iter().map(&mut of).collect()
}
