//! The training losses of a round, kept beside the update.

use crate::error::ParticipantError;
use crate::state_files;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};

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
    /// The file of the history of `round`.
    pub fn path(state: &Path, round: u64) -> PathBuf {
        state.join(format!("round-{round}.training.json"))
    }

    /// The history of `round`; `None` if the node did not train.
    pub fn read(state: &Path, round: u64) -> Result<Option<Self>, ParticipantError> {
        state_files::read_json(&Self::path(state, round), MAX_HISTORY_BYTES)
    }

    /// The steps made in the rounds before `round`. A missing or unreadable history counts as none.
    pub fn steps_before(state: &Path, round: u64) -> u64 {
        let entries = fs::read_dir(state).into_iter().flatten().flatten();
        let rounds = entries.filter_map(|entry| {
            let name = entry.file_name();
            let number = name.to_str()?.strip_prefix("round-")?;
            number.strip_suffix(".training.json")?.parse().ok()
        });
        let earlier = rounds.filter(|number: &u64| *number < round);
        let histories = earlier.filter_map(|number| Self::read(state, number).ok().flatten());
        histories.map(|history| history.losses.len() as u64).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_earlier_rounds_are_counted() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path();
        for (round, steps) in [(2, 5), (9, 7), (10, 11)] {
            let losses = vec![0.5; steps];
            let history = TrainingHistory { round, losses };
            state_files::write_json(&TrainingHistory::path(path, round), &history).unwrap();
        }
        fs::write(path.join("round-3.training.json"), "{").unwrap();
        fs::write(path.join("round-4.safetensors"), "").unwrap();
        let counted = [0, 3, 10, 11].map(|round| TrainingHistory::steps_before(path, round));
        assert_eq!(counted, [0, 5, 12, 23]);
    }
}
