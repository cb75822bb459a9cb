//! Which episodes can be saved: those with whole rows and all pictures of each camera.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use arrow_array::RecordBatch;

use crate::dataset::metadata::info::{Camera, CameraStorage};
use crate::dataset::recover::described;
use crate::dataset::recover::encode;
use crate::dataset::recover::folder::recording::{EpisodeToWrite, Recording, VideoToWrite};
use crate::dataset::recover::leftovers::{self, SingleVideo, Video};
use crate::dataset::recover::placing::{place, Stretch, VideoFrames};
use crate::dataset::recover::report::{Lost, Recovered, Saved};
use crate::dataset::recover::rows::{self, EpisodeRows};
use crate::dataset::recover::source::Source;
use crate::dataset::recover::statistics::columns::Statistics;
use crate::dataset::recover::stored;
use crate::dataset::{Dataset, DatasetError};

/// Chooses the episodes to save, and reports on all.
pub(crate) fn choose(root: &Path, source: Source) -> Result<(Recording, Recovered), DatasetError> {
    let Source { info, places, .. } = &source;
    let mut episodes = rows::episodes(places, info.fps, source.tasks.len());
    let mut report = Recovered {
        notes: source.notes.clone(),
        ..Recovered::default()
    };
    // For a killed process, and where metadata gives pictures twice, only the videos tell where episodes are.
    let described = Dataset::open(root);
    let exactly = matches!(&described, Err(DatasetError::SharedPictures { .. }));
    if let Ok(dataset) = &described {
        let repairs = dataset.repairs().iter();
        report.notes.extend(repairs.map(ToString::to_string));
        let mut known = BTreeSet::new();
        episodes.retain(|episode| known.insert(episode.number));
    }
    let (mut cameras, mut stored) = (Vec::new(), Vec::new());
    for (number, camera) in info.cameras.iter().enumerate() {
        if camera.storage == CameraStorage::Pictures {
            stored.push(PicturesInRows {
                camera: camera.name.clone(),
                statistics: stored::statistics(&source.files, camera, &episodes),
            });
            continue;
        }
        if let Ok(dataset) = &described {
            cameras.push(Filmed::described(dataset, number, camera, &episodes));
            continue;
        }
        cameras.push(Filmed::find(
            root,
            camera,
            &episodes,
            info.fps,
            exactly,
            &mut report.notes,
        )?);
    }
    report
        .lost
        .extend(without_rows(root, &info.cameras, places)?);
    let (mut at, mut kept) = (0, Vec::new());
    episodes.retain(|episode| {
        let filmed = |camera: &Filmed| camera.pictures[at].as_ref().err().cloned();
        let in_rows = |camera: &PicturesInRows| camera.statistics[at].as_ref().err().cloned();
        let fault = episode.fault.clone();
        let missing = fault
            .or_else(|| cameras.iter().find_map(filmed))
            .or_else(|| stored.iter().find_map(in_rows));
        at += 1;
        let saved = missing.is_none();
        report.lost.extend(missing.map(|cause| Lost {
            episode: episode.number,
            cause,
        }));
        kept.push(saved);
        saved
    });
    for camera in &mut cameras {
        keep(&mut camera.pictures, &kept);
    }
    for camera in &mut stored {
        keep(&mut camera.statistics, &kept);
    }
    report.lost.sort_by_key(|lost| lost.episode);
    if episodes.is_empty() {
        let causes: Vec<String> = report
            .lost
            .iter()
            .take(20)
            .map(ToString::to_string)
            .collect();
        return Err(DatasetError::meta(
            root,
            match &causes[..] {
                [] => "has no episode that was saved; LeRobot writes nothing of an episode but pictures before that".into(),
                causes => format!("no episode can be saved:\n{}", causes.join("\n")),
            },
        ));
    }
    for (at, episode) in episodes.iter().enumerate() {
        report.saved.push(Saved {
            recorded_as: episode.number.unsigned_abs(),
            frames: episode.rows.len(),
            encoded_here: cameras.iter().any(|camera| camera.is_encoded_here(at)),
        });
    }
    Ok((recording(source, &episodes, cameras, stored), report))
}

fn keep<T>(of_episodes: &mut Vec<T>, kept: &[bool]) {
    let mut kept = kept.iter();
    of_episodes.retain(|_| kept.next() == Some(&true));
}

struct PicturesInRows {
    camera: String,
    /// Per episode, or why it cannot be saved.
    statistics: Vec<Result<Statistics, String>>,
}

enum Pictures {
    /// In a video by LeRobot.
    Video(Stretch),
    /// In files not encoded yet.
    Files(Vec<PathBuf>),
}

struct Filmed {
    camera: Camera,
    fps: u32,
    videos: Vec<Video>,
    /// Per episode, or why there are none.
    pictures: Vec<Result<Pictures, String>>,
}

impl Filmed {
    fn described(
        dataset: &Dataset,
        number: usize,
        camera: &Camera,
        episodes: &[EpisodeRows],
    ) -> Self {
        let (paths, stretches) = described::stretches(dataset, number, episodes);
        Self {
            camera: camera.clone(),
            fps: dataset.fps(),
            videos: paths
                .into_iter()
                .map(|path| Video {
                    path,
                    frames: VideoFrames::default(),
                })
                .collect(),
            pictures: stretches
                .into_iter()
                .map(|stretch| stretch.map(Pictures::Video))
                .collect(),
        }
    }

    fn find(
        root: &Path,
        camera: &Camera,
        episodes: &[EpisodeRows],
        fps: u32,
        exactly: bool,
        notes: &mut Vec<String>,
    ) -> Result<Self, DatasetError> {
        let (mut videos, unreadable) = leftovers::videos(root, camera)?;
        let lengths: Vec<usize> = episodes.iter().map(|e| e.rows.len()).collect();
        let frames: Vec<VideoFrames> = videos.iter().map(|v| v.frames.clone()).collect();
        // After an episode with incomplete rows, the next one's start is unknown.
        let placed = episodes.iter().take_while(|e| e.is_placed).count();
        let placing = place(&lengths[..placed], &frames, fps, exactly);
        if placing.surplus > 0 && placed == lengths.len() {
            notes.push(format!(
                "the last video of {} has {} pictures more than there are rows; they are left in it",
                camera.name, placing.surplus
            ));
        }
        let mut single = Vec::new();
        for SingleVideo { episode, video } in leftovers::single_videos(root, camera)? {
            match (episode, video) {
                (episode, Ok(video)) => single.push((episode, video)),
                (None, Err(error)) => notes.push(format!(
                    "{error}; it is of an episode that was being recorded, and that is lost"
                )),
                // The pictures it was to be made of remain.
                (Some(_), Err(_)) => {}
            }
        }
        let mut pictures: Vec<_> = placing
            .stretches
            .into_iter()
            .map(Pictures::Video)
            .map(Ok)
            .collect();
        for (at, episode) in episodes.iter().enumerate().skip(pictures.len()) {
            let (length, is_last) = (lengths[at], at + 1 == episodes.len());
            let number = episode.number.unsigned_abs();
            let files = leftovers::pictures(root, camera, number)?;
            // A video without a number belongs to the last episode.
            let fits = |(of, video): &(Option<u64>, Video)| {
                video.frames.times.len() == length && of.map_or(is_last, |of| of == number)
            };
            let found = if let Some(of_it) = single.iter().position(fits) {
                let (_, video) = single.swap_remove(of_it);
                videos.push(video);
                let video = videos.len() - 1;
                Ok(Pictures::Video(
                    videos[video].frames.stretch(video, 0, length, fps),
                ))
            } else if files.len() == length {
                match encode::refusal(camera, &files) {
                    Some(cause) => Err(cause),
                    None => Ok(Pictures::Files(files)),
                }
            } else if let Some(misfit) = &placing.fault {
                Err(format!(
                    "{} has {} pictures, which do not fit the rows of its episodes; LeRobot drops pictures where streaming encoding is \
                     too slow, and nothing reports where",
                    videos[misfit.video].path.display(),
                    misfit.pictures
                ))
            } else if let Some(error) = &unreadable {
                Err(error.to_string())
            } else if at >= placed {
                Err(format!(
                    "rows of an episode before it are missing, so that nothing states where its pictures are in the videos of {}",
                    camera.name
                ))
            } else {
                Err(format!(
                    "{length} rows, and {} left {} of its pictures: its video was not finished",
                    camera.name,
                    match files.len() {
                        0 => "none".into(),
                        some => some.to_string(),
                    }
                ))
            };
            pictures.push(found);
        }
        Ok(Self {
            camera: camera.clone(),
            fps,
            videos,
            pictures,
        })
    }

    fn is_encoded_here(&self, episode: usize) -> bool {
        matches!(self.pictures.get(episode), Some(Ok(Pictures::Files(_))))
    }

    /// The camera's videos to write, and each episode's stretch: first LeRobot's videos, then one of all pictures not encoded yet.
    fn into_videos(self) -> (Vec<VideoToWrite>, Vec<(usize, f64, f64)>) {
        let used: BTreeSet<usize> = self
            .pictures
            .iter()
            .filter_map(|p| match p {
                Ok(Pictures::Video(stretch)) => Some(stretch.video),
                _ => None,
            })
            .collect();
        let new_number = |video: usize| used.iter().position(|&u| u == video).unwrap_or(0);
        let mut encoded: Vec<Vec<PathBuf>> = Vec::new();
        let mut stretches = Vec::new();
        let seconds = |frames: usize| frames as f64 / f64::from(self.fps);
        for pictures in self.pictures.into_iter().flatten() {
            stretches.push(match pictures {
                Pictures::Video(Stretch { video, from, to }) => (new_number(video), from, to),
                Pictures::Files(files) => {
                    let first = encoded.iter().map(Vec::len).sum();
                    let end = first + files.len();
                    encoded.push(files);
                    (used.len(), seconds(first), seconds(end))
                }
            });
        }
        let copied = used
            .iter()
            .map(|&at| VideoToWrite::Copy(self.videos[at].path.clone()));
        let mut videos: Vec<VideoToWrite> = copied.collect();
        if !encoded.is_empty() {
            let (camera, fps) = (self.camera, self.fps);
            videos.push(VideoToWrite::Make(Box::new(move |path| {
                encode::write_mp4(path, &camera, fps, &encoded)
            })));
        }
        (videos, stretches)
    }
}

/// The episode being recorded: it has pictures and no rows.
fn without_rows(
    root: &Path,
    cameras: &[Camera],
    places: &[rows::RowPlace],
) -> Result<Vec<Lost>, DatasetError> {
    let with_rows: BTreeSet<i64> = places.iter().map(|place| place.episode).collect();
    let mut found = BTreeSet::new();
    for camera in cameras {
        for number in leftovers::episodes_with_pictures(root, &camera.name)? {
            found.extend(
                i64::try_from(number)
                    .ok()
                    .filter(|n| !with_rows.contains(n)),
            );
        }
    }
    let lost = |episode| {
        Lost {
        episode,
        cause: "it has pictures and no rows; LeRobot keeps the rows in memory until an episode is saved".into(),
    }
    };
    Ok(found.into_iter().map(lost).collect())
}

fn recording(
    source: Source,
    episodes: &[EpisodeRows],
    cameras: Vec<Filmed>,
    stored: Vec<PicturesInRows>,
) -> Recording {
    let mut videos = Vec::new();
    let mut stretches = Vec::new();
    for camera in cameras {
        let name = camera.camera.clone();
        let (files, of_episodes) = camera.into_videos();
        videos.push((name, files));
        stretches.push(of_episodes);
    }
    let pictures = |at: usize| {
        let of = |camera: &PicturesInRows| {
            let statistics = camera.statistics.get(at)?.as_ref().ok()?;
            Some((camera.camera.clone(), statistics.clone()))
        };
        stored.iter().filter_map(of).collect()
    };
    Recording {
        info: source.json,
        fps: source.info.fps,
        tasks: source.tasks,
        schema: source.schema,
        episodes: episodes
            .iter()
            .enumerate()
            .map(|(at, episode)| EpisodeToWrite {
                rows: slices(&source.batches, episode.rows.clone()),
                read_from: episode.rows.clone(),
                tasks: episode.tasks.clone(),
                stretches: stretches.iter().map(|camera| camera[at]).collect(),
                pictures: pictures(at),
            })
            .collect(),
        videos,
        files: source.files,
    }
}

/// Rows counted over all batches.
fn slices(batches: &[RecordBatch], rows: std::ops::Range<usize>) -> Vec<RecordBatch> {
    let (mut found, mut start) = (Vec::new(), 0);
    for batch in batches {
        let end = start + batch.num_rows();
        let (from, to) = (rows.start.max(start), rows.end.min(end));
        if from < to {
            found.push(batch.slice(from - start, to - from));
        }
        start = end;
    }
    found
}
