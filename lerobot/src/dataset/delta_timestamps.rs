//! LeRobot's `delta_timestamps`: which frames around the current one a training sample has, per feature.

use std::collections::BTreeMap;

use crate::dataset::metadata::info::{ACTION, STATE};
use crate::dataset::tables::motion::TOLERANCE;
use crate::dataset::{DatasetError, Info};

/// Most frames that one feature can be asked for at, and the furthest that one may be away.
pub(crate) const MAX_WINDOW: usize = 4096;

/// Seconds relative to the current frame, per feature: `observation.state`, `action`, or a camera.
///
/// Every offset has to be a multiple of `1 / fps`, within LeRobot's tolerance of 1e-4 s. Where a frame would lie outside the
/// episode its first or last one is given, and flagged as padding. A feature that is not named is given at the current frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DeltaTimestamps(BTreeMap<String, Vec<f64>>);

impl DeltaTimestamps {
    /// Every feature at the current frame alone.
    pub fn new() -> Self {
        Self::default()
    }

    /// The same, with `feature` at these offsets.
    pub fn with(mut self, feature: impl Into<String>, seconds: impl Into<Vec<f64>>) -> Self {
        self.0.insert(feature.into(), seconds.into());
        self
    }

    /// The offsets in frames of a recording.
    ///
    /// # Errors
    /// [`DatasetError::DeltaTimestamps`]: a feature that the recording does not have, no offsets or more than 4096, or one that is
    /// not a multiple of `1 / fps` or further than 4096 frames.
    pub fn window(&self, info: &Info) -> Result<Window, DatasetError> {
        let mut window = Window::now(info);
        for (key, seconds) in &self.0 {
            let wrong = |cause: String| DatasetError::DeltaTimestamps {
                key: key.clone(),
                cause,
            };
            let camera = info.cameras.iter().position(|c| &c.name == key);
            let place = match (key.as_str(), camera) {
                (STATE, _) => &mut window.state,
                (ACTION, _) => &mut window.action,
                (_, Some(camera)) => &mut window.cameras[camera],
                (_, None) => {
                    return Err(wrong(
                        "the recording has no camera, state or action of that name".into(),
                    ))
                }
            };
            if !(1..=MAX_WINDOW).contains(&seconds.len()) {
                return Err(wrong(format!(
                    "{} offsets given; it has to be 1 to {MAX_WINDOW}",
                    seconds.len()
                )));
            }
            *place = seconds
                .iter()
                .map(|&s| offset(s, info.fps).map_err(wrong))
                .collect::<Result<_, _>>()?;
        }
        Ok(window)
    }
}

/// The number of frames that `seconds` are.
fn offset(seconds: f64, fps: u32) -> Result<i64, String> {
    let fps = f64::from(fps);
    let frames = seconds * fps;
    let whole = frames.round();
    let fits = (frames - whole).abs() / fps <= TOLERANCE;
    // NaN does not.
    if !fits {
        return Err(format!(
            "{seconds} s is not a multiple of 1/{fps} s (within {TOLERANCE} s)"
        ));
    }
    if whole.abs() > MAX_WINDOW as f64 {
        return Err(format!("{seconds} s is more than {MAX_WINDOW} frames away"));
    }
    Ok(whole as i64)
}

/// The frames of a training sample: offsets from the current one, per feature, in frames.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Window {
    pub(crate) state: Vec<i64>,
    pub(crate) action: Vec<i64>,
    /// One list per camera, in the order of the recording's cameras.
    pub(crate) cameras: Vec<Vec<i64>>,
}

impl Window {
    /// Everything at the current frame alone.
    pub(crate) fn now(info: &Info) -> Self {
        Self {
            state: vec![0],
            action: vec![0],
            cameras: vec![vec![0]; info.cameras.len()],
        }
    }

    /// SmolVLA's: observations now, `chunk` actions from now on.
    pub(crate) fn chunk(info: &Info, chunk: usize) -> Result<Self, DatasetError> {
        if !(1..=MAX_WINDOW).contains(&chunk) {
            return Err(DatasetError::Chunk {
                chunk,
                max: MAX_WINDOW,
            });
        }
        Ok(Self {
            action: (0..chunk as i64).collect(),
            ..Self::now(info)
        })
    }

    /// Offsets of `observation.state`.
    pub fn state(&self) -> &[i64] {
        &self.state
    }

    /// Offsets of `action`.
    pub fn action(&self) -> &[i64] {
        &self.action
    }

    /// Offsets of a camera, by its number; empty if there is no such camera.
    pub fn camera(&self, number: usize) -> &[i64] {
        self.cameras.get(number).map_or(&[], Vec::as_slice)
    }
}
