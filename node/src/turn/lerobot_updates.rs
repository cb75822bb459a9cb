//! Updates in the form that LeRobot reads. The node itself does not need them, and each has 0.4 GB at the published size.

use crate::error::ParticipantError;
use crate::state_files::{self, at};
use std::fs;
use std::io::ErrorKind;
use std::path::Path;

/// How many updates of older rounds stay.
const OLD: usize = 2;

fn name(round: u64) -> String {
    format!("round-{round}.safetensors")
}

/// The round of a file with exactly such a name.
fn round_of(file: &str) -> Option<u64> {
    let number = file.strip_prefix("round-")?.strip_suffix(".safetensors")?;
    let round = number.parse().ok()?;
    (name(round) == file).then_some(round)
}

/// Keeps the update of `round`, and of the rounds before it the newest two.
pub fn keep(state: &Path, round: u64, update: &[u8]) -> Result<(), ParticipantError> {
    state_files::write(&state.join(name(round)), update)?;
    let mut older = Vec::new();
    for file in fs::read_dir(state).map_err(at(state))? {
        let file = file.map_err(at(state))?;
        let number = file.file_name().to_str().and_then(round_of);
        older.extend(number.filter(|number| *number < round));
    }
    older.sort_unstable();
    let stay = older.len().saturating_sub(OLD);
    for round in &older[..stay] {
        let path = state.join(name(*round));
        match fs::remove_file(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            removed => removed.map_err(at(&path))?,
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_older_updates_stay() {
        let dir = tempfile::tempdir().unwrap();
        let state = dir.path();
        let others = [
            "round-1.training.json",
            "round-x.safetensors",
            "round-01.safetensors",
            "round-+1.safetensors",
            "secret",
        ];
        for name in others {
            fs::write(state.join(name), "").unwrap();
        }
        let kept = || {
            let there = (0..30).filter(|round| state.join(name(*round)).exists());
            there.collect::<Vec<_>>()
        };
        for round in [1, 2, 9] {
            keep(state, round, b"update").unwrap();
        }
        assert_eq!(kept(), [1, 2, 9]);
        keep(state, 10, b"update").unwrap();
        assert_eq!(kept(), [2, 9, 10]);
        // The node goes on with a round that it has begun.
        keep(state, 10, b"again").unwrap();
        assert_eq!(kept(), [2, 9, 10]);
        keep(state, 20, b"update").unwrap();
        assert_eq!(kept(), [9, 10, 20]);
        // Those of a network that was here before.
        keep(state, 5, b"update").unwrap();
        assert_eq!(kept(), [5, 9, 10, 20]);
        assert!(others.iter().all(|name| state.join(name).exists()));
    }
}
