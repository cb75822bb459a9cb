//! Where a readable recording's pictures are by its metadata, in which reading corrected wrong places (merges by LeRobot 0.4.0 to 0.4.2).

use std::fs::File;
use std::path::{Path, PathBuf};

use crate::dataset::recover::placing::Stretch;
use crate::dataset::recover::rows::EpisodeRows;
use crate::dataset::video::mp4::track::Mp4Track;
use crate::dataset::Dataset;

/// A camera's videos, and each episode's stretch or why it has none.
pub(crate) fn stretches(
    dataset: &Dataset,
    camera: usize,
    episodes: &[EpisodeRows],
) -> (Vec<PathBuf>, Vec<Result<Stretch, String>>) {
    let mut videos: Vec<PathBuf> = Vec::new();
    let mut faults: Vec<Option<String>> = Vec::new();
    let mut of = |episode: &EpisodeRows| {
        let number = usize::try_from(episode.number).unwrap_or(usize::MAX);
        let left_out = dataset.left_out();
        if let Some(short) = left_out.iter().find(|short| short.episode == number) {
            return Err(format!(
                "{} has {} pictures for its {} rows, and nothing tells which are missing",
                short.camera, short.pictures, short.rows
            ));
        }
        let known = dataset.episodes();
        let at = known.binary_search_by_key(&number, |episode| episode.recorded);
        let span = at.ok().and_then(|at| known[at].video(camera));
        let span = span.ok_or("the metadata does not describe it")?;
        let video = videos.iter().position(|path| *path == span.path);
        let video = video.unwrap_or_else(|| {
            videos.push(span.path.clone());
            faults.push(fault(&span.path));
            videos.len() - 1
        });
        if let Some(fault) = &faults[video] {
            return Err(fault.clone());
        }
        let from = span.from_timestamp;
        // Pictures after the last row are not the episode's.
        let to = from + episode.rows.len() as f64 / f64::from(dataset.fps());
        Ok(Stretch { video, from, to })
    };
    let stretches = episodes.iter().map(&mut of).collect();
    (videos, stretches)
}

/// Why a video cannot be copied: a damaged index, or missing bytes.
fn fault(path: &Path) -> Option<String> {
    let read = File::open(path)
        .map_err(|error| format!("cannot be read: {error}"))
        .and_then(|mut file| Mp4Track::read(&mut file));
    let fault = read.err()?;
    Some(format!("{}: {fault}", path.display()))
}
