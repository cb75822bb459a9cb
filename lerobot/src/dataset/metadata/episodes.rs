//! Which rows and which stretches of video belong to each episode: v3.0 here, v2.x in `episodes_v2`.

use std::path::{Path, PathBuf};

use crate::dataset::metadata::episode::{Episode, VideoSpan};
use crate::dataset::metadata::episodes_v2;
use crate::dataset::metadata::info::{CameraStorage, FormatVersion};
use crate::dataset::metadata::paths::RecordingFile;
use crate::dataset::tables::columns::{self, Columns};
use crate::dataset::tables::parquet_files::parquet_files;
use crate::dataset::{DatasetError, Info, Repair};

/// Episodes in order, checked to tile the frames of `meta/info.json`.
pub(crate) fn read_episodes(
    root: &Path,
    info: &Info,
    repairs: &mut Vec<Repair>,
) -> Result<Vec<Episode>, DatasetError> {
    let (source, episodes) = if info.format < FormatVersion::V30 {
        episodes_v2::read_episodes(root, info, repairs)?
    } else {
        read_parquet(root, info, repairs)?
    };
    let frames = episodes.last().map_or(0, |e| e.frames.end);
    if episodes.len() != info.total_episodes || frames != info.total_frames {
        return Err(DatasetError::meta(
            source,
            format!(
                "describes {} episodes with {frames} frames, meta/info.json declares {} with {}",
                episodes.len(),
                info.total_episodes,
                info.total_frames
            ),
        ));
    }
    Ok(episodes)
}

/// `meta/episodes` of v3.0.
fn read_parquet(
    root: &Path,
    info: &Info,
    repairs: &mut Vec<Repair>,
) -> Result<(PathBuf, Vec<Episode>), DatasetError> {
    let folder = root.join("meta/episodes");
    let mut episodes: Vec<Episode> = Vec::new();
    for path in parquet_files(&folder)? {
        let layout = EpisodeColumns::of(&path, info)?;
        let mut repeated = 0;
        columns::read(&path, &layout.all(), 1, |batch| {
            for row in 0..batch.rows() {
                let (number, start) = next(&episodes);
                let found = layout.row(batch, row, number)?;
                let follows = number < info.total_episodes
                    && found.index == number as i64
                    && found.from == start as i64
                    && found.to > found.from
                    && found.to <= info.total_frames as i64
                    && found.length == found.to.saturating_sub(found.from);
                let known = usize::try_from(found.index)
                    .ok()
                    .and_then(|index| episodes.get(index));
                if follows {
                    let episode = layout.episode(root, info, &path, batch, row, &found)?;
                    episodes.push(episode);
                } else if known.is_some_and(|first| found.describes(first))
                    && Some(&layout.episode(root, info, &path, batch, row, &found)?) == known
                {
                    repeated += 1;
                } else {
                    let by_place = if found.index == number as i64 {
                        ""
                    } else {
                        "; LeRobot (0.6.1) takes the rows of this table for episodes 0, 1, 2 and so on, and gives wrong frames \
                             here: write it sorted by episode_index"
                    };
                    return Err(DatasetError::meta(
                        &path,
                        format!(
                            "expected episode {number} of {} from frame {start} on, found episode {} of {} frames, {}..{}; \
                             episodes have to follow each other and end at frame {}{by_place}",
                            info.total_episodes,
                            found.index,
                            found.length,
                            found.from,
                            found.to,
                            info.total_frames
                        ),
                    ));
                }
            }
            Ok(())
        })?;
        if repeated > 0 {
            repairs.push(Repair::RepeatedEpisodes {
                path,
                rows: repeated,
            });
        }
    }
    Ok((folder, episodes))
}

/// Number and first frame of the next episode.
fn next(episodes: &[Episode]) -> (usize, usize) {
    (episodes.len(), episodes.last().map_or(0, |e| e.frames.end))
}

struct EpisodeRow {
    index: i64,
    length: i64,
    from: i64,
    to: i64,
}

impl EpisodeRow {
    fn describes(&self, episode: &Episode) -> bool {
        let frames = &episode.frames;
        (self.from, self.to) == (frames.start as i64, frames.end as i64)
            && self.length == frames.len() as i64
    }
}

struct EpisodeColumns {
    /// The [`EpisodeColumns::HINTS`] that exist.
    hints: Vec<&'static str>,
    /// Per camera; `None` for stored pictures.
    spans: Vec<Option<SpanColumns>>,
}

struct SpanColumns {
    chunk: String,
    file: String,
    from: String,
    to: Option<String>,
}

impl EpisodeColumns {
    const BOUNDS: [&'static str; 2] = ["dataset_from_index", "dataset_to_index"];
    /// LeRobot does not need them: they may be missing or hold no number.
    const HINTS: [&'static str; 4] = [
        "episode_index",
        "length",
        "data/chunk_index",
        "data/file_index",
    ];

    fn of(path: &Path, info: &Info) -> Result<Self, DatasetError> {
        let spans = info.cameras.iter().map(|camera| {
            if camera.storage == CameraStorage::Pictures {
                return Ok(None);
            }
            let column = |name: &str| format!("videos/{}/{name}", camera.name);
            let to = column("to_timestamp");
            Ok(Some(SpanColumns {
                chunk: column("chunk_index"),
                file: column("file_index"),
                from: column("from_timestamp"),
                to: (!columns::present(path, &[&to])?.is_empty()).then_some(to),
            }))
        });
        Ok(Self {
            hints: columns::present(path, &Self::HINTS)?,
            spans: spans.collect::<Result<_, DatasetError>>()?,
        })
    }

    fn all(&self) -> Vec<&str> {
        let spans = self.spans.iter().flatten().flat_map(|span| {
            let to = span.to.as_deref();
            [&span.chunk[..], &span.file, &span.from]
                .into_iter()
                .chain(to)
        });
        let hints = self.hints.iter().copied();
        Self::BOUNDS.into_iter().chain(hints).chain(spans).collect()
    }

    /// A row, by default that of episode `number`.
    fn row(&self, batch: &Columns, row: usize, number: usize) -> Result<EpisodeRow, DatasetError> {
        let int = |name: &str| batch.ints(name).map(|column| column[row]);
        let (from, to) = (int(Self::BOUNDS[0])?, int(Self::BOUNDS[1])?);
        let hint = |at: usize| int(Self::HINTS[at]).ok();
        Ok(EpisodeRow {
            index: hint(0).unwrap_or(number as i64),
            length: hint(1).unwrap_or(to.saturating_sub(from)),
            from,
            to,
        })
    }

    fn episode(
        &self,
        root: &Path,
        info: &Info,
        path: &Path,
        batch: &Columns,
        row: usize,
        found: &EpisodeRow,
    ) -> Result<Episode, DatasetError> {
        let broken =
            |cause: String| DatasetError::meta(path, format!("episode {}: {cause}", found.index));
        let number = |name: &str| {
            let value = batch.ints(name)?[row];
            u64::try_from(value).map_err(|_| broken(format!("{name} is {value}")))
        };
        let hint = |at: usize| number(Self::HINTS[at]).unwrap_or(0);
        let place = RecordingFile::Shared {
            chunk: hint(2),
            file: hint(3),
        };
        let data_file = info.data_file(root, place)?;
        let mut videos = Vec::with_capacity(info.cameras.len());
        let sound = |seconds: &f64| (0.0..1e9).contains(seconds);
        for (camera, span) in info.cameras.iter().zip(&self.spans) {
            let Some(span) = span else {
                videos.push(None);
                continue;
            };
            let SpanColumns {
                chunk, file, from, ..
            } = span;
            let from_timestamp = batch.doubles(from)?[row];
            if !sound(&from_timestamp) {
                return Err(broken(format!("{from} is {from_timestamp}")));
            }
            // LeRobot does not read the end, so a fault in it does not matter.
            let to = span.to.as_ref().and_then(|to| batch.doubles(to).ok());
            let place = RecordingFile::Shared {
                chunk: number(chunk)?,
                file: number(file)?,
            };
            videos.push(Some(VideoSpan {
                path: info.video_file(root, camera, place)?,
                from_timestamp,
                to_timestamp: to.map(|to| to[row]).filter(sound),
            }));
        }
        Ok(Episode {
            index: found.index as usize,
            recorded: found.index as usize,
            frames: found.from as usize..found.to as usize,
            videos,
            data_file,
        })
    }
}
