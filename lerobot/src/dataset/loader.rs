//! Frames as a policy is trained on them: pictures and state now, actions from now on, or whatever else a [`Window`] asks for.

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

/// What LeRobot's `__getitem__` gives for one frame under some `delta_timestamps`.
///
/// Values at offsets outside the episode are those of its first or last frame, and flagged as padding.
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
    /// Pictures, camera after camera in the order of [`Dataset::cameras`], each at its offsets in order: by default one per
    /// camera, of this frame.
    pub images: Vec<Image>,
    /// Per picture, whether it is a repetition.
    pub image_is_pad: Vec<bool>,
    /// `observation.state` at its offsets, `[offsets, dim]` row-major, not normalised; by default of this frame alone.
    pub state: Vec<f32>,
    /// Per state, whether it is a repetition.
    pub state_is_pad: Vec<bool>,
    /// Actions at their offsets, `[offsets, dim]` row-major, not normalised; by default this frame's and the following ones.
    pub actions: Vec<f32>,
    /// Per action, whether it is a repetition.
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

/// Gives frames with their pictures, keeping one open video or data file per camera and the pictures of the last frame given.
///
/// Ascending order decodes every video once; going back starts from the nearest key frame. Where pictures are stored one by one, going
/// anywhere else than ahead decompresses their page anew.
pub struct Loader<'a> {
    dataset: &'a Dataset,
    window: Window,
    cameras: Vec<OpenCamera>,
}

/// One camera's open video or data file, and the pictures that the last sample took from it, by frame of the dataset.
#[derive(Default)]
struct OpenCamera {
    video: Option<VideoReader>,
    pictures: Option<PictureColumn>,
    shown: BTreeMap<usize, Image>,
}

impl Dataset {
    /// A loader of frames with action chunks of `chunk` frames: random access, fastest in order.
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
    /// A loader of frames with those of `window` around them, which has to be one of this recording.
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
    /// There is no such frame, or a picture cannot be had: which one, the file and the cause.
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

    /// Frame `index` without its pictures ([`Frame::images`] is empty): no video is touched.
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

    /// Pictures of these frames, all of one episode; each is decoded once, in ascending order.
    fn images(&mut self, camera: usize, wanted: &[usize]) -> Result<Vec<Image>, DatasetError> {
        // One picture is not kept, because the next frame does not ask for it again.
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

    /// The picture that a camera took of frame `index`, which exists.
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
                // The timestamp was checked to be `frame / fps`. In float32 it would be less exact.
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

    /// The PNG or JPEG picture of frame `index`, which exists, as the recording stores it. The camera is one with
    /// [`CameraStorage::Pictures`](crate::dataset::CameraStorage::Pictures).
    ///
    /// # Errors
    /// It cannot be read: the file and the cause.
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
    /// What a stretch of video shows `seconds` after it began.
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

/// The frames at `offsets` from `index`, held within the episode, and which of them had to be held.
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
