//! Decodes every picture, to find faults before training does.

use crate::dataset::window::Window;
use crate::dataset::{Dataset, DatasetError, Loader};

/// A fault of an episode's pictures.
#[derive(Debug)]
pub struct PictureFault {
    /// The first unreadable picture: episode, frame, camera, file and cause.
    pub error: DatasetError,
    /// Later episodes that fail alike.
    pub more_episodes: usize,
}

impl Dataset {
    /// Decodes every picture; gives the first fault of every episode and camera, unless the episode before has the same. `progress` gets
    /// the pictures done and their total.
    pub fn picture_faults(&self, mut progress: impl FnMut(usize, usize)) -> Vec<PictureFault> {
        let mut faults = Vec::new();
        let all = self.len() * self.cameras().len();
        let window = Window::now(self.info());
        for camera in 0..self.cameras().len() {
            // Camera by camera, so that only one video is open.
            let mut loader = Loader::new(self, window.clone());
            let mut last: Option<(PictureFault, String)> = None;
            for episode in self.episodes() {
                let fault = episode.frames.clone().find_map(|frame| {
                    progress(camera * self.len() + frame + 1, all);
                    loader.picture(camera, frame).err()
                });
                let Some(error) = fault else { continue };
                let cause = cause(&error);
                match &mut last {
                    Some((fault, before)) if *before == cause => fault.more_episodes += 1,
                    _ => {
                        let fault = PictureFault {
                            error,
                            more_episodes: 0,
                        };
                        faults.extend(last.replace((fault, cause)).map(|(fault, _)| fault));
                    }
                }
            }
            faults.extend(last.map(|(fault, _)| fault));
        }
        progress(all, all);
        faults
    }
}

/// The fault without its frame.
fn cause(error: &DatasetError) -> String {
    match error {
        DatasetError::Picture { source, .. } => source.to_string(),
        other => other.to_string(),
    }
}
