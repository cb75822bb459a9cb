//! Every picture of a recording decoded, to find what is wrong with it before training does.

use crate::dataset::window::Window;
use crate::dataset::{Dataset, DatasetError, Loader};

/// Something wrong with the pictures of an episode.
#[derive(Debug)]
pub struct PictureFault {
    /// The first picture that cannot be had: episode, frame, camera, file and cause.
    pub error: DatasetError,
    /// Episodes after it that fail in the same way.
    pub more_episodes: usize,
}

impl Dataset {
    /// Decodes every picture; gives the first fault of every episode and camera, where it differs from that of the episode before.
    /// `progress` is called with the pictures done and their number.
    pub fn picture_faults(&self, mut progress: impl FnMut(usize, usize)) -> Vec<PictureFault> {
        let mut faults = Vec::new();
        let all = self.len() * self.cameras().len();
        let window = Window::now(self.info());
        for camera in 0..self.cameras().len() {
            // The cameras are checked one after another, so that only one video is open.
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

/// What is wrong, without saying at which frame.
fn cause(error: &DatasetError) -> String {
    match error {
        DatasetError::Picture { source, .. } => source.to_string(),
        other => other.to_string(),
    }
}
