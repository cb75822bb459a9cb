//! A whole recording, prepared: the bridge from [`crate::dataset`] to [`crate::sample`].

use crate::dataset::{Dataset, DatasetError};
use crate::error::PolicyError;
use crate::sample::{CameraImage, Observation, PreparedSample, Preparer};

impl Preparer<'_> {
    /// Prepares every frame of a recording, in order, normalising with the recording's own statistics. `progress` is
    /// called with the frames done and their total.
    pub fn prepare_dataset(
        &self,
        dataset: &Dataset,
        mut progress: impl FnMut(usize, usize),
    ) -> std::result::Result<Vec<PreparedSample>, PrepareError> {
        let stats = dataset.stats();
        let mut samples = Vec::with_capacity(dataset.len());
        for frame in dataset.frames(self.config().chunk_size)? {
            let mut frame = frame?;
            stats.state.normalize(&mut frame.state);
            stats.action.normalize(&mut frame.actions);
            let cameras = dataset
                .cameras()
                .iter()
                .zip(&frame.images)
                .map(|(camera, image)| CameraImage {
                    name: &camera.name,
                    height: image.height,
                    width: image.width,
                    pixels: &image.pixels,
                });
            samples.push(self.prepare(&Observation {
                cameras: cameras.collect(),
                state: &frame.state,
                actions: &frame.actions,
                is_pad: &frame.action_is_pad,
                task: &frame.task,
            })?);
            progress(samples.len(), dataset.len());
        }
        Ok(samples)
    }
}

/// Preparing a whole recording can fail in the recording or in the policy.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// The recording cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A frame does not fit the policy.
    #[error(transparent)]
    Policy(#[from] PolicyError),
}
