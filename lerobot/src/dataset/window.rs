//! Which frames around the current one a training sample has, per feature.

use crate::dataset::{DatasetError, Info};

const MAX_CHUNK: usize = 4096;

/// The frames of a training sample: offsets from the current frame, per feature.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Window {
    /// Offsets of `observation.state`.
    pub state: Vec<i64>,
    /// Offsets of `action`.
    pub action: Vec<i64>,
    /// Offsets per camera, in the recording's order.
    pub cameras: Vec<Vec<i64>>,
}

impl Window {
    /// Only the current frame.
    pub fn now(info: &Info) -> Self {
        Self {
            state: vec![0],
            action: vec![0],
            cameras: vec![vec![0]; info.cameras.len()],
        }
    }

    /// SmolVLA's: observations now, `chunk` actions from now on.
    pub(crate) fn chunk(info: &Info, chunk: usize) -> Result<Self, DatasetError> {
        if !(1..=MAX_CHUNK).contains(&chunk) {
            return Err(DatasetError::Chunk {
                chunk,
                max: MAX_CHUNK,
            });
        }
        Ok(Self {
            action: (0..chunk as i64).collect(),
            ..Self::now(info)
        })
    }
}
