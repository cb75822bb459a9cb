//! The training losses of a round, kept beside the update.

use crate::{error::ParticipantError, state_files};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Largest training history that is read.
const MAX_HISTORY_BYTES: u64 = 64 << 20;

/// Training losses of one round, kept beside the update.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TrainingHistory {
    /// The round.
    pub round: u64,
    /// The batch's loss before each step.
    pub losses: Vec<f32>,
}

impl TrainingHistory {
    /// Where a node with this state folder keeps it.
    pub fn path(state: &Path, round: u64) -> PathBuf {
        state.join(format!("round-{round}.training.json"))
    }

    /// What the node with this state folder wrote in `round`; `None` if it did not train.
    pub fn read(state: &Path, round: u64) -> Result<Option<Self>, ParticipantError> {
        state_files::read_json(&Self::path(state, round), MAX_HISTORY_BYTES)
    }
}
