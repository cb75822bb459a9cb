//! Prepares whole recordings: from [`zk0_lerobot::dataset`] to [`crate::frames::sample`].

use zk0_lerobot::dataset::{Dataset, DatasetError, Frame, Loader};

use crate::error::PolicyError;
use crate::frames::making::DecodedFrame;
use crate::frames::sample::{
    CameraImage, FromFrame, Observation, Pixels, PreparedSample, Preparer,
};

impl Preparer<'_> {
    /// Prepares the frames `wanted`, normalised with [`Dataset::normalisation`]. Ascending order is fastest. `progress` gets the frames
    /// done and their total.
    pub fn prepare_frames(
        &self,
        dataset: &Dataset,
        wanted: impl ExactSizeIterator<Item = usize>,
        mut progress: impl FnMut(usize, usize),
    ) -> std::result::Result<Vec<PreparedSample>, PrepareError> {
        let mut loader = dataset.loader(self.config().chunk_size)?;
        let count = wanted.len();
        let mut samples = Vec::with_capacity(count);
        for index in wanted {
            samples.push(self.prepare_frame(dataset, &mut loader, index)?);
            progress(samples.len(), count);
        }
        Ok(samples)
    }

    /// Makes a sample of frame `index` with the recording's loader.
    pub fn prepare_frame<S: FromFrame>(
        &self,
        dataset: &Dataset,
        loader: &mut Loader,
        index: usize,
    ) -> std::result::Result<S, PrepareError> {
        let decoded = DecodedFrame {
            frame: loader.frame(index)?,
            pictures: None,
        };
        Ok(self.prepare_decoded(dataset, decoded)?)
    }

    /// Makes a sample of a decoded frame.
    ///
    /// # Errors
    /// The frame does not fit the policy.
    pub fn prepare_decoded<S: FromFrame>(
        &self,
        dataset: &Dataset,
        decoded: DecodedFrame,
    ) -> std::result::Result<S, PolicyError> {
        let DecodedFrame {
            mut frame,
            pictures,
        } = decoded;
        normalise(dataset, &mut frame);
        let transformed = |place: usize| pictures.as_ref().and_then(|all| all.get(place));
        let images = dataset.cameras().iter().zip(&frame.images);
        let cameras = images
            .enumerate()
            .map(|(place, (camera, image))| CameraImage {
                name: &camera.name,
                height: image.height,
                width: image.width,
                pixels: match transformed(place) {
                    Some(picture) => Pixels::Unit(&picture.values),
                    None => Pixels::Bytes(&image.pixels),
                },
            });
        let observation = Observation {
            cameras: cameras.collect(),
            state: &frame.state,
            actions: &frame.actions,
            is_pad: &frame.action_is_pad,
            task: &frame.task,
        };
        S::from_frame(self, &observation)
    }
}

/// To mean 0 and standard deviation 1.
pub(crate) fn normalise(dataset: &Dataset, frame: &mut Frame) {
    dataset.normalisation().state.normalize(&mut frame.state);
    dataset.normalisation().action.normalize(&mut frame.actions);
}

/// Why a recording cannot be prepared.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// The recording cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A frame does not fit the policy.
    #[error(transparent)]
    Policy(#[from] PolicyError),
}
