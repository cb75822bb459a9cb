//! `meta/tasks.parquet` and `meta/episodes`: which rows and which stretches of video belong together.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::columns;
use super::{DatasetError, Info};

/// One demonstration: consecutive frames, and where each camera filmed them.
#[derive(Debug, Clone)]
pub struct Episode {
    /// Number of the episode, from 0.
    pub index: usize,
    /// Its frames in the dataset's numbering; never empty.
    pub frames: Range<usize>,
    /// Its stretch of video per camera, in the order of [`Dataset::cameras`](super::Dataset::cameras).
    pub videos: Vec<VideoSpan>,
    /// The parquet file that holds its rows.
    pub(super) data_file: PathBuf,
}

/// Where an episode lies in a camera's video file; several episodes share one.
#[derive(Debug, Clone, PartialEq)]
pub struct VideoSpan {
    /// The mp4 file.
    pub path: PathBuf,
    /// Second of the file at which the episode's first frame is shown.
    pub from_timestamp: f64,
}

/// Task strings by `task_index`.
pub(super) fn read_tasks(root: &Path, info: &Info) -> Result<Vec<String>, DatasetError> {
    const TASK: &str = "__index_level_0__"; // the pandas index, which is how LeRobot stores it
    let path = root.join("meta/tasks.parquet");
    let mut tasks: Vec<Option<String>> = Vec::new();
    columns::read(&path, &["task_index", TASK], |batch| {
        for (&index, task) in batch.ints("task_index")?.iter().zip(batch.strings(TASK)?) {
            let at = usize::try_from(index).unwrap_or(usize::MAX);
            if at >= info.total_tasks {
                return Err(DatasetError::meta(
                    &path,
                    format!(
                        "task_index {index} where meta/info.json counts {} tasks",
                        info.total_tasks
                    ),
                ));
            }
            if tasks.len() <= at {
                tasks.resize(at + 1, None);
            }
            tasks[at] = Some(task);
        }
        Ok(())
    })?;
    let found = tasks.len();
    match tasks.into_iter().collect::<Option<Vec<_>>>() {
        Some(tasks) if found == info.total_tasks => Ok(tasks),
        _ => Err(DatasetError::meta(
            &path,
            format!(
                "does not name all {} tasks of meta/info.json",
                info.total_tasks
            ),
        )),
    }
}

/// Episodes in order, checked to tile the frames that `meta/info.json` declares.
pub(super) fn read_episodes(root: &Path, info: &Info) -> Result<Vec<Episode>, DatasetError> {
    let span_columns: Vec<[String; 3]> = info
        .cameras
        .iter()
        .map(|c| {
            ["chunk_index", "file_index", "from_timestamp"]
                .map(|f| format!("videos/{}/{f}", c.name))
        })
        .collect();
    let mut names = vec![
        "episode_index",
        "length",
        "dataset_from_index",
        "dataset_to_index",
        "data/chunk_index",
        "data/file_index",
    ];
    names.extend(span_columns.iter().flatten().map(String::as_str));

    let folder = root.join("meta/episodes");
    let mut episodes: Vec<Episode> = Vec::new();
    for path in parquet_files(&folder)? {
        let broken = |cause: String| DatasetError::meta(&path, cause);
        columns::read(&path, &names, |batch| {
            let [index, length, from, to, chunk, file] = [0, 1, 2, 3, 4, 5].map(|i| names[i]);
            let (index, length) = (batch.ints(index)?, batch.ints(length)?);
            let (from, to) = (batch.ints(from)?, batch.ints(to)?);
            let (chunk, file) = (batch.ints(chunk)?, batch.ints(file)?);
            for row in 0..batch.rows() {
                let number = episodes.len();
                let start = episodes.last().map_or(0, |e| e.frames.end);
                let end = usize::try_from(to[row]).unwrap_or(0);
                if number >= info.total_episodes
                    || usize::try_from(index[row]) != Ok(number)
                    || usize::try_from(from[row]) != Ok(start)
                    || end <= start
                    || end > info.total_frames
                    || usize::try_from(length[row]) != Ok(end - start)
                {
                    return Err(broken(format!(
                        "expected episode {number} of {} from frame {start} on, found episode {} of {} frames, {}..{}; \
                         episodes have to follow each other and end at frame {}",
                        info.total_episodes, index[row], length[row], from[row], to[row], info.total_frames
                    )));
                }
                let position = |name: &str, value: i64| {
                    u64::try_from(value)
                        .map_err(|_| broken(format!("episode {number}: {name} is {value}")))
                };
                let data_file = info
                    .data_file(
                        position("data/chunk_index", chunk[row])?,
                        position("data/file_index", file[row])?,
                    )
                    .map_err(|cause| DatasetError::meta(root.join("meta/info.json"), cause))?;
                let mut videos = Vec::with_capacity(info.cameras.len());
                for (camera, [chunk, file, from]) in info.cameras.iter().zip(&span_columns) {
                    let from_timestamp = batch.doubles(from)?[row];
                    if !(0.0..1e9).contains(&from_timestamp) {
                        return Err(broken(format!(
                            "episode {number}: {from} is {from_timestamp}"
                        )));
                    }
                    let (c, f) = (batch.ints(chunk)?[row], batch.ints(file)?[row]);
                    let file = info
                        .video_file(&camera.name, position(chunk, c)?, position(file, f)?)
                        .map_err(|cause| DatasetError::meta(root.join("meta/info.json"), cause))?;
                    let path = root.join(file);
                    if !path.is_file() {
                        return Err(DatasetError::MissingFile { path });
                    }
                    videos.push(VideoSpan {
                        path,
                        from_timestamp,
                    });
                }
                episodes.push(Episode {
                    index: number,
                    frames: start..end,
                    videos,
                    data_file: root.join(data_file),
                });
            }
            Ok(())
        })?;
    }
    let frames = episodes.last().map_or(0, |e| e.frames.end);
    if episodes.len() != info.total_episodes || frames != info.total_frames {
        return Err(DatasetError::meta(
            folder,
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

/// `chunk-*/file-*.parquet` under `folder`, in name order as LeRobot reads them.
fn parquet_files(folder: &Path) -> Result<Vec<PathBuf>, DatasetError> {
    let list = |dir: &Path| -> Result<Vec<PathBuf>, DatasetError> {
        let mut found = Vec::new();
        for entry in std::fs::read_dir(dir).map_err(|e| DatasetError::io(dir, e))? {
            found.push(entry.map_err(|e| DatasetError::io(dir, e))?.path());
        }
        found.sort();
        Ok(found)
    };
    let mut files = Vec::new();
    for chunk in list(folder)?.into_iter().filter(|p| p.is_dir()) {
        files.extend(
            list(&chunk)?
                .into_iter()
                .filter(|p| p.extension().is_some_and(|e| e == "parquet")),
        );
    }
    Ok(files)
}
