//! `meta/episodes.jsonl` of v2.0 and v2.1: every episode has its own parquet file and its own video per camera.

use std::collections::btree_map::{BTreeMap, Entry};
use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::dataset::metadata::episode::{Episode, VideoSpan};
use crate::dataset::metadata::info::CameraStorage;
use crate::dataset::metadata::json;
use crate::dataset::{DatasetError, Info, Repair};

#[derive(Deserialize)]
struct EpisodeLine {
    episode_index: usize,
    length: usize,
}

/// The file's path, and the episodes by number, each beginning where the last ends.
pub(crate) fn read_episodes(
    root: &Path,
    info: &Info,
    repairs: &mut Vec<Repair>,
) -> Result<(PathBuf, Vec<Episode>), DatasetError> {
    let path = root.join("meta/episodes.jsonl");
    // LeRobot sorts, too.
    let mut lengths: BTreeMap<usize, usize> = BTreeMap::new();
    let mut repeated = 0;
    json::read_lines(&path, |number, line: EpisodeLine| {
        let EpisodeLine {
            episode_index: index,
            length,
        } = line;
        let wrong =
            |cause: String| Err(DatasetError::meta(&path, format!("line {number}: {cause}")));
        if index >= info.total_episodes {
            return wrong(format!(
                "episode {index} where meta/info.json declares {} episodes",
                info.total_episodes
            ));
        }
        if length == 0 || length > info.total_frames {
            return wrong(format!(
                "episode {index} has {length} frames where meta/info.json declares {} in all",
                info.total_frames
            ));
        }
        match lengths.entry(index) {
            Entry::Vacant(place) => {
                place.insert(length);
            }
            Entry::Occupied(first) if *first.get() == length => repeated += 1,
            Entry::Occupied(first) => {
                return wrong(format!(
                    "episode {index} has {length} frames, an earlier line states {}",
                    first.get()
                ))
            }
        }
        Ok(())
    })?;
    if repeated > 0 {
        repairs.push(Repair::RepeatedEpisodes {
            path: path.clone(),
            rows: repeated,
        });
    }

    let mut episodes: Vec<Episode> = Vec::with_capacity(lengths.len());
    for (index, length) in lengths {
        let (number, start) = (episodes.len(), episodes.last().map_or(0, |e| e.frames.end));
        if index != number {
            return Err(DatasetError::meta(
                path,
                format!("has no line for episode {number}"),
            ));
        }
        let place = info.place_of_episode(index as u64);
        let videos = info.cameras.iter().map(|camera| match camera.storage {
            CameraStorage::Pictures => Ok(None),
            CameraStorage::Video => Ok(Some(VideoSpan {
                path: info.video_file(root, camera, place)?,
                from_timestamp: 0.0,
                to_timestamp: None,
            })),
        });
        episodes.push(Episode {
            index,
            recorded: index,
            frames: start..start.saturating_add(length),
            videos: videos.collect::<Result<_, DatasetError>>()?,
            data_file: info.data_file(root, place)?,
        });
    }
    Ok((path, episodes))
}
