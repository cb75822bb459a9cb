//! Merges by LeRobot 0.4.0 to 0.4.2. Their metadata names a source's last video file for all its episodes, and adds earlier files' seconds.
//! The files are right: episodes fill them in order.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::dataset::metadata::episode::{Episode, VideoSpan};
use crate::dataset::metadata::info::Camera;
use crate::dataset::metadata::paths::RecordingFile;
use crate::dataset::video_fit::picture_times::PictureTimes;
use crate::dataset::{DatasetError, Info, Repair};

/// Places the episodes again where the metadata must be wrong and only one placing fills the files.
///
/// # Errors
/// Two episodes have the same pictures, and the files are not filled exactly.
pub(crate) fn repair(
    root: &Path,
    info: &Info,
    episodes: &mut [Episode],
    repairs: &mut Vec<Repair>,
) -> Result<(), DatasetError> {
    for (number, camera) in info.cameras.iter().enumerate() {
        let Some(fault) = fault(info, episodes, number) else {
            continue;
        };
        match (filled(root, info, camera, episodes, number), fault) {
            (Some(spans), _) => {
                let mut moved = 0;
                for (episode, span) in episodes.iter_mut().zip(spans) {
                    let is_there = |is: &VideoSpan| {
                        let off = (is.from_timestamp - span.from_timestamp) * f64::from(info.fps);
                        is.path == span.path && off.abs() <= 0.5
                    };
                    if !episode.video(number).is_some_and(is_there) {
                        episode.videos[number] = Some(span);
                        moved += 1;
                    }
                }
                if moved > 0 {
                    repairs.push(Repair::MergedVideos {
                        camera: camera.name.clone(),
                        episodes: moved,
                    });
                }
            }
            (
                None,
                MetadataFault::Shared {
                    path,
                    first,
                    second,
                },
            ) => {
                return Err(DatasetError::SharedPictures {
                    path,
                    camera: camera.name.clone(),
                    first,
                    second,
                })
            }
            // Pictures are missing: their episodes are found one by one.
            (None, MetadataFault::BeyondTheEnd) => {}
        }
    }
    Ok(())
}

enum MetadataFault {
    /// Two episodes have the same pictures.
    Shared {
        path: PathBuf,
        first: usize,
        second: usize,
    },
    /// A file ends before an episode.
    BeyondTheEnd,
}

fn fault(info: &Info, episodes: &[Episode], camera: usize) -> Option<MetadataFault> {
    let half = 0.5 / f64::from(info.fps);
    let mut by_file: BTreeMap<&Path, Vec<(f64, f64, usize)>> = BTreeMap::new();
    for (number, episode) in episodes.iter().enumerate() {
        let span = episode.video(camera)?;
        let stretch = (span.from_timestamp, span.to_timestamp?, number);
        by_file.entry(&span.path).or_default().push(stretch);
    }
    let mut beyond = None;
    for (path, mut stretches) in by_file {
        stretches.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
        let shared = |pair: &&[(f64, f64, usize)]| pair[1].0 < pair[0].1 - half;
        if let Some(pair) = stretches.windows(2).find(shared) {
            return Some(MetadataFault::Shared {
                path: path.into(),
                first: pair[0].2,
                second: pair[1].2,
            });
        }
        let Some(times) = PictureTimes::read(path) else {
            continue;
        };
        let ends = |&(from, to, _): &(f64, f64, usize)| {
            times.between(from, to, info.fps) < pictures(from, to, info.fps)
        };
        if stretches.iter().any(ends) {
            beyond = Some(MetadataFault::BeyondTheEnd);
        }
    }
    beyond
}

fn pictures(from: f64, to: f64, fps: u32) -> usize {
    ((to - from) * f64::from(fps)).round() as usize
}

/// Where episodes are if they fill the camera's files in order; `None` unless exactly.
fn filled(
    root: &Path,
    info: &Info,
    camera: &Camera,
    episodes: &[Episode],
    number: usize,
) -> Option<Vec<VideoSpan>> {
    let open = |(chunk, file)| {
        let path = info.video_file(root, camera, RecordingFile::Shared { chunk, file });
        let path = path.ok()?;
        let pictures = PictureTimes::read(&path)?.len();
        Some(((chunk, file), path, pictures))
    };
    let following = |(chunk, file)| open((chunk, file + 1)).or_else(|| open((chunk + 1, 0)));
    let seconds = |pictures: usize| pictures as f64 / f64::from(info.fps);
    let (mut place, mut path, mut there) = open((0, 0))?;
    let mut used = 0;
    let mut spans = Vec::with_capacity(episodes.len());
    for episode in episodes {
        let span = episode.video(number)?;
        let pictures = pictures(span.from_timestamp, span.to_timestamp?, info.fps);
        if used == there {
            ((place, path, there), used) = (following(place)?, 0);
        }
        if pictures == 0 {
            return None;
        }
        spans.push(VideoSpan {
            path: path.clone(),
            from_timestamp: seconds(used),
            to_timestamp: Some(seconds(used + pictures)),
        });
        used += pictures;
    }
    (used == there && following(place).is_none()).then_some(spans)
}
