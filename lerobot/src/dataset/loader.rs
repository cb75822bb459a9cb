//! Frames for training: pictures and state now, actions from now on, or any other [`Window`].

use std::collections::BTreeMap;
use std::ops::Range;

use crate::dataset::metadata::episode::VideoSpan;
use crate::dataset::metadata::info::Camera;
use crate::dataset::picture::decode::decode;
use crate::dataset::tables::motion::TOLERANCE;
use crate::dataset::tables::pictures::{PictureColumn, StoredPicture};
use crate::dataset::video::reader::VideoReader;
use crate::dataset::window::Window;
use crate::dataset::{Dataset, DatasetError};

/// What LeRobot's `__getitem__` gives for a frame under some `delta_timestamps`.
///
/// Offsets outside the episode give its first or last frame, flagged as padding.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Its number in the dataset.
    pub index: usize,
    /// Its episode.
    pub episode: usize,
    /// Its number in the episode.
    pub frame: usize,
    /// Seconds since the episode began.
    pub timestamp: f32,
    /// Index into [`Dataset::tasks`].
    pub task_index: usize,
    /// The robot's instruction.
    pub task: String,
    /// Pictures by camera in the order of [`Dataset::cameras`], then by offset; by default one per camera, of this frame.
    pub images: Vec<Image>,
    /// Per picture, whether it is padding.
    pub image_is_pad: Vec<bool>,
    /// `observation.state` at its offsets, `[offsets, dim]` row-major, not normalised; by default of this frame.
    pub state: Vec<f32>,
    /// Per state, whether it is padding.
    pub state_is_pad: Vec<bool>,
    /// Actions at their offsets, as [`Frame::state`]; by default from this frame on.
    pub actions: Vec<f32>,
    /// Per action, whether it is padding.
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

/// Gives frames with their pictures. Keeps one open file per camera, and the last frame's pictures.
///
/// Ascending order decodes every video once; going back starts from the nearest key frame. With stored pictures, any step but ahead
/// decompresses their page again.
pub struct Loader<'a> {
    dataset: &'a Dataset,
    window: Window,
    cameras: Vec<OpenCamera>,
}

/// A camera's open file, and the last sample's pictures by frame.
#[derive(Default)]
struct OpenCamera {
    video: Option<VideoReader>,
    pictures: Option<PictureColumn>,
    shown: BTreeMap<usize, Image>,
}

impl Dataset {
    /// A loader of frames with chunks of `chunk` actions: random access, fastest in order.
    ///
    /// # Errors
    /// `chunk` is 0 or above 4096.
    pub fn loader(&self, chunk: usize) -> Result<Loader<'_>, DatasetError> {
        Ok(Loader::new(self, Window::chunk(self.info(), chunk)?))
    }

    /// One frame; a [`Loader`] is faster for more than one.
    ///
    /// # Errors
    /// As [`Loader::frame`].
    pub fn frame(&self, index: usize, chunk: usize) -> Result<Frame, DatasetError> {
        self.loader(chunk)?.frame(index)
    }
}

impl<'a> Loader<'a> {
    /// A loader with `window`, which must be of this recording.
    pub fn new(dataset: &'a Dataset, window: Window) -> Self {
        Self {
            dataset,
            window,
            cameras: dataset
                .cameras()
                .iter()
                .map(|_| OpenCamera::default())
                .collect(),
        }
    }

    /// Frame `index` with its pictures.
    ///
    /// # Errors
    /// There is no such frame, or a picture cannot be read.
    pub fn frame(&mut self, index: usize) -> Result<Frame, DatasetError> {
        let mut frame = self.motion(index)?;
        let episode = self.dataset.episodes()[frame.episode].frames.clone();
        for camera in 0..self.cameras.len() {
            let offsets = self.window.cameras.get(camera);
            let offsets = offsets.map_or(&[][..], Vec::as_slice);
            let (wanted, is_pad) = within(&episode, index, offsets);
            frame.images.extend(self.images(camera, &wanted)?);
            frame.image_is_pad.extend(is_pad);
        }
        Ok(frame)
    }

    /// Frame `index` without pictures ([`Frame::images`] is empty); reads no video.
    ///
    /// # Errors
    /// There is no such frame.
    pub fn motion(&self, index: usize) -> Result<Frame, DatasetError> {
        let (dataset, motion) = (self.dataset, &self.dataset.motion);
        let at = dataset
            .episodes()
            .partition_point(|e| e.frames.end <= index);
        let Some(episode) = dataset.episodes().get(at) else {
            return Err(DatasetError::OutOfRange {
                index,
                len: dataset.len(),
            });
        };
        let (states, state_is_pad) = within(&episode.frames, index, &self.window.state);
        let (actions, action_is_pad) = within(&episode.frames, index, &self.window.action);
        let task_index = motion.task(index);
        let rows = |frames: Vec<usize>, row: &dyn Fn(usize) -> &'a [f32]| -> Vec<f32> {
            frames.into_iter().flat_map(row).copied().collect()
        };
        Ok(Frame {
            index,
            episode: episode.index,
            frame: index - episode.frames.start,
            timestamp: motion.timestamp(index),
            task_index,
            task: dataset.tasks()[task_index].clone(),
            images: Vec::new(),
            image_is_pad: Vec::new(),
            state: rows(states, &|frame| motion.state(frame)),
            state_is_pad,
            actions: rows(actions, &|frame| motion.action(frame)),
            action_is_pad,
        })
    }

    /// Pictures of one episode's frames, each decoded once, in order.
    fn images(&mut self, camera: usize, wanted: &[usize]) -> Result<Vec<Image>, DatasetError> {
        // A single picture is not kept: the next frame does not need it.
        if let [frame] = wanted {
            return Ok(vec![self.picture(camera, *frame)?]);
        }
        let mut before = std::mem::take(&mut self.cameras[camera].shown);
        let mut shown = BTreeMap::new();
        let mut ascending = wanted.to_vec();
        ascending.sort_unstable();
        ascending.dedup();
        for frame in ascending {
            let image = match before.remove(&frame) {
                Some(image) => image,
                None => self.picture(camera, frame)?,
            };
            shown.insert(frame, image);
        }
        let images = wanted.iter().map(|frame| shown[frame].clone()).collect();
        self.cameras[camera].shown = shown;
        Ok(images)
    }

    /// Frame `index` must exist.
    pub(crate) fn picture(&mut self, camera: usize, index: usize) -> Result<Image, DatasetError> {
        let at = self
            .dataset
            .episodes()
            .partition_point(|e| e.frames.end <= index);
        let episode = &self.dataset.episodes()[at];
        let frame = index - episode.frames.start;
        let size = &self.dataset.cameras()[camera];
        let pixels = match &episode.videos[camera] {
            Some(span) => self.cameras[camera].shown_at(
                span,
                size,
                // The checked timestamp is `frame / fps`; float32 would be less exact.
                frame as f64 / f64::from(self.dataset.fps()),
            ),
            None => self.stored(camera, index).and_then(|stored| {
                decode(&stored.bytes, size.height, size.width).map_err(|cause| {
                    DatasetError::StoredPicture {
                        path: stored.file,
                        cause,
                    }
                })
            }),
        };
        let pixels = pixels.map_err(|source| DatasetError::Picture {
            episode: episode.recorded,
            frame,
            camera: size.name.clone(),
            source: Box::new(source),
        })?;
        Ok(Image {
            height: size.height,
            width: size.width,
            pixels,
        })
    }

    /// The stored PNG or JPEG of frame `index`, which exists. The camera has
    /// [`CameraStorage::Pictures`](crate::dataset::CameraStorage::Pictures).
    ///
    /// # Errors
    /// It cannot be read.
    pub fn stored_picture(&mut self, camera: usize, index: usize) -> Result<Vec<u8>, DatasetError> {
        Ok(self.stored(camera, index)?.bytes)
    }

    fn stored(&mut self, camera: usize, index: usize) -> Result<StoredPicture, DatasetError> {
        let dataset = self.dataset;
        let (path, row) = dataset.motion.row(index);
        let slot = &mut self.cameras[camera].pictures;
        if slot.as_ref().is_some_and(|open| open.path() != path) {
            *slot = None;
        }
        let pictures = match slot {
            Some(pictures) => pictures,
            None => {
                let feature = &dataset.cameras()[camera].feature;
                slot.insert(PictureColumn::open(dataset.root(), path, feature)?)
            }
        };
        pictures.stored(row)
    }
}

impl OpenCamera {
    fn shown_at(
        &mut self,
        span: &VideoSpan,
        size: &Camera,
        seconds: f64,
    ) -> Result<Vec<u8>, DatasetError> {
        let slot = &mut self.video;
        if slot.as_ref().is_some_and(|open| open.path() != span.path) {
            *slot = None;
        }
        let video = match slot {
            Some(video) => video,
            None => slot.insert(VideoReader::open(&span.path, size.height, size.width)?),
        };
        let number = video.frame_at(span.from_timestamp + seconds, TOLERANCE)?;
        video.rgb(number)
    }
}

/// The frames at `offsets`, clamped to the episode, and which were clamped.
fn within(episode: &Range<usize>, index: usize, offsets: &[i64]) -> (Vec<usize>, Vec<bool>) {
    let (first, last) = (episode.start as i64, episode.end as i64 - 1);
    offsets
        .iter()
        .map(|offset| {
            let wanted = (index as i64).saturating_add(*offset);
            let held = wanted.clamp(first, last);
            (held as usize, held != wanted)
        })
        .unzip()
}
