//! Episodes with fewer pictures than rows: a recorder dropped some (LeRobot's streaming encoding when too slow), or the file ends early.
//! Nothing tells which are missing.

use std::collections::{BTreeMap, HashSet};
use std::fmt;
use std::path::{Path, PathBuf};

use crate::dataset::metadata::episode::{Episode, VideoSpan};
use crate::dataset::metadata::info::FormatVersion;
use crate::dataset::tables::motion::Motion;
use crate::dataset::video_fit::picture_times::PictureTimes;
use crate::dataset::{Info, Repair};

/// An episode that is not in the [`Dataset`](crate::dataset::Dataset): a camera has too few pictures.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftOut {
    /// Its number in the files.
    pub episode: usize,
    /// The camera.
    pub camera: String,
    /// Its video.
    pub path: PathBuf,
    /// Its pictures.
    pub pictures: usize,
    /// Its rows.
    pub rows: usize,
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(
            f,
            "{}: episode {} is left out: camera {} has {} pictures for its {} rows, and nothing tells which are missing, so that every \
             row from frame 0 on may have the picture of another moment. LeRobot trains on it without a word. Record it again",
            self.path.display(),
            self.episode,
            self.camera,
            self.pictures,
            self.rows
        )
    }
}

/// Episodes with too few pictures, by camera. Cameras with too many are added to `repairs`.
pub(crate) fn find(info: &Info, episodes: &[Episode], repairs: &mut Vec<Repair>) -> Vec<LeftOut> {
    let mut short = Vec::new();
    for (number, camera) in info.cameras.iter().enumerate() {
        let (mut surplus, mut first) = (0, None);
        for (episode, span, pictures) in pictures(info, episodes, number) {
            let rows = episode.frames.len();
            if pictures < rows {
                short.push(LeftOut {
                    episode: episode.recorded,
                    camera: camera.name.clone(),
                    path: span.path.clone(),
                    pictures,
                    rows,
                });
            } else if pictures > rows {
                surplus += 1;
                first.get_or_insert((episode.recorded, pictures, rows));
            }
        }
        if let Some((episode, pictures, rows)) = first {
            repairs.push(Repair::SurplusPictures {
                camera: camera.name.clone(),
                episodes: surplus,
                first: episode,
                pictures,
                rows,
            });
        }
    }
    short
}

/// Pictures per episode, in order.
fn pictures<'a>(
    info: &Info,
    episodes: &'a [Episode],
    camera: usize,
) -> Vec<(&'a Episode, &'a VideoSpan, usize)> {
    let mut by_file: BTreeMap<&Path, Vec<(&Episode, &VideoSpan)>> = BTreeMap::new();
    for episode in episodes {
        if let Some(span) = episode.video(camera) {
            by_file.entry(&span.path).or_default().push((episode, span));
        }
    }
    let half = 0.5 / f64::from(info.fps);
    let mut counts = Vec::with_capacity(episodes.len());
    for (path, mut spans) in by_file {
        spans.sort_by(|a, b| a.1.from_timestamp.total_cmp(&b.1.from_timestamp));
        let times = PictureTimes::read(path);
        let (mut begin, mut next) = (f64::INFINITY, f64::INFINITY);
        for (episode, span) in spans.into_iter().rev() {
            let (from, to) = (span.from_timestamp, span.to_timestamp);
            let rows = episode.frames.len();
            // Without ends, episodes with the same first picture share it.
            if from < begin - half {
                next = begin;
            }
            begin = from;
            let pictures = match (&times, to) {
                (Some(times), to) => match times.between(from, next, info.fps) {
                    // All are of this episode, even if the end is the last picture's time.
                    pictures if pictures == rows => rows,
                    pictures => match to {
                        Some(to) => times.between(from, to, info.fps),
                        // Pictures between two episodes need not belong to the first.
                        None if info.format == FormatVersion::V30 => pictures.min(rows),
                        None => pictures,
                    },
                },
                (None, Some(to)) => ((to - from) * f64::from(info.fps)).round() as usize,
                (None, None) => rows,
            };
            counts.push((episode, span, pictures));
        }
    }
    counts.sort_by_key(|(episode, ..)| episode.index);
    counts
}

/// Removes episodes and their rows, and renumbers the others to tile the frames.
pub(crate) fn remove(short: &[LeftOut], episodes: &mut Vec<Episode>, motion: &mut Motion) {
    if short.is_empty() {
        return;
    }
    let short: HashSet<usize> = short.iter().map(|left_out| left_out.episode).collect();
    episodes.retain(|episode| !short.contains(&episode.recorded));
    motion.keep(episodes.iter().map(|episode| episode.frames.clone()));
    let mut start = 0;
    for (index, episode) in episodes.iter_mut().enumerate() {
        episode.index = index;
        episode.frames = start..start + episode.frames.len();
        start = episode.frames.end;
    }
}
