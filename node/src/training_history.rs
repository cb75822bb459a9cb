//! The training losses of a round. A node keeps them beside the update.

use crate::error::ParticipantError;
use crate::state_files;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Largest training history that is read.
const MAX_HISTORY_BYTES: u64 = 64 << 20;

/// The training losses of one round.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TrainingHistory {
    /// The round.
    pub round: u64,
    /// The batch's loss before each step.
    pub losses: Vec<f32>,
}

impl TrainingHistory {
    /// The file in which a node with this state folder keeps the history of `round`.
    pub fn path(state: &Path, round: u64) -> PathBuf {
        state.join(format!("round-{round}.training.json"))
    }

    /// The history that the node with this state folder wrote in `round`; `None` if it did not train.
    pub fn read(state: &Path, round: u64) -> Result<Option<Self>, ParticipantError> {
        state_files::read_json(&Self::path(state, round), MAX_HISTORY_BYTES)
    }
}
