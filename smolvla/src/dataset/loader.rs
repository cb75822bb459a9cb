//! Frames as a policy is trained on them: pictures and state now, actions from now on.

use super::motion::TOLERANCE;
use super::video::VideoReader;
use super::{Dataset, DatasetError};

const MAX_CHUNK: usize = 4096;

/// What LeRobot's `__getitem__` gives for one frame with SmolVLA's `delta_timestamps`.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Number of the frame in the dataset.
    pub index: usize,
    /// Its episode.
    pub episode: usize,
    /// Number of the frame in its episode.
    pub frame: usize,
    /// Seconds since the episode began.
    pub timestamp: f32,
    /// Which of [`Dataset::tasks`].
    pub task_index: usize,
    /// What the robot was told to do.
    pub task: String,
    /// One picture per camera, in the order of [`Dataset::cameras`].
    pub images: Vec<Image>,
    /// `observation.state`, not normalised.
    pub state: Vec<f32>,
    /// Actions of this frame and the following ones, `[chunk, dim]` row-major, not normalised; past the end of the episode
    /// the last one repeats.
    pub actions: Vec<f32>,
    /// Per action of the chunk, whether it is such a repetition.
    pub action_is_pad: Vec<bool>,
}

/// A picture, 8-bit RGB. LeRobot's float32 image is `pixel / 255`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Pixels from top to bottom.
    pub height: usize,
    /// Pixels from left to right.
    pub width: usize,
    /// `[3, height, width]`, row-major.
    pub pixels: Vec<u8>,
}

/// Gives frames with their pictures, keeping one open video per camera.
///
/// Ascending order decodes every video once; going back starts from the nearest key frame.
pub struct Loader<'a> {
    dataset: &'a Dataset,
    chunk: usize,
    videos: Vec<Option<VideoReader>>,
}

impl<'a> Loader<'a> {
    pub(super) fn new(dataset: &'a Dataset, chunk: usize) -> Result<Self, DatasetError> {
        if !(1..=MAX_CHUNK).contains(&chunk) {
            return Err(DatasetError::Chunk {
                chunk,
                max: MAX_CHUNK,
            });
        }
        Ok(Self {
            dataset,
            chunk,
            videos: dataset.cameras().iter().map(|_| None).collect(),
        })
    }

    /// Frame `index` with its pictures.
    ///
    /// # Errors
    /// There is no such frame, or a picture cannot be had: which one, the file and the cause.
    pub fn frame(&mut self, index: usize) -> Result<Frame, DatasetError> {
        let mut frame = self.motion(index)?;
        for camera in 0..self.videos.len() {
            let image = self
                .image(&frame, camera)
                .map_err(|source| DatasetError::Picture {
                    episode: frame.episode,
                    frame: frame.frame,
                    camera: self.dataset.cameras()[camera].name.clone(),
                    source: Box::new(source),
                })?;
            frame.images.push(image);
        }
        Ok(frame)
    }

    /// Frame `index` without its pictures ([`Frame::images`] is empty): no video is touched.
    ///
    /// # Errors
    /// There is no such frame.
    pub fn motion(&self, index: usize) -> Result<Frame, DatasetError> {
        let (dataset, motion) = (self.dataset, &self.dataset.motion);
        let at = dataset.episodes.partition_point(|e| e.frames.end <= index);
        let Some(episode) = dataset.episodes.get(at) else {
            return Err(DatasetError::OutOfRange {
                index,
                len: dataset.len(),
            });
        };
        let last = episode.frames.end - 1;
        let wanted = index..index + self.chunk;
        let task_index = motion.task(index);
        Ok(Frame {
            index,
            episode: episode.index,
            frame: index - episode.frames.start,
            timestamp: motion.timestamp(index),
            task_index,
            task: dataset.tasks[task_index].clone(),
            images: Vec::with_capacity(self.videos.len()),
            state: motion.state(index).to_vec(),
            actions: wanted
                .clone()
                .flat_map(|i| motion.action(i.min(last)))
                .copied()
                .collect(),
            action_is_pad: wanted.map(|i| i > last).collect(),
        })
    }

    fn image(&mut self, frame: &Frame, camera: usize) -> Result<Image, DatasetError> {
        let span = &self.dataset.episodes[frame.episode].videos[camera];
        let size = &self.dataset.cameras()[camera];
        let slot = &mut self.videos[camera];
        if slot.as_ref().is_some_and(|open| open.path() != span.path) {
            *slot = None;
        }
        let video = match slot {
            Some(video) => video,
            None => slot.insert(VideoReader::open(&span.path, size.height, size.width)?),
        };
        // The timestamp is checked to be `frame / fps`; in float32 it would be less exact.
        let seconds = span.from_timestamp + frame.frame as f64 / f64::from(self.dataset.fps());
        let number = video.frame_at(seconds, TOLERANCE)?;
        Ok(Image {
            height: size.height,
            width: size.width,
            pixels: video.rgb(number)?,
        })
    }
}

/// All frames in order; ends after the first error.
pub struct Frames<'a> {
    loader: Loader<'a>,
    next: usize,
}

impl<'a> Frames<'a> {
    pub(super) fn new(loader: Loader<'a>) -> Self {
        Self { loader, next: 0 }
    }
}

impl Iterator for Frames<'_> {
    type Item = Result<Frame, DatasetError>;

    fn next(&mut self) -> Option<Self::Item> {
        let len = self.loader.dataset.len();
        if self.next >= len {
            return None;
        }
        let frame = self.loader.frame(self.next);
        self.next = if frame.is_ok() { self.next + 1 } else { len };
        Some(frame)
    }
}
