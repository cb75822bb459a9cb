//! Whether this machine has room for a round. A node checks it before the long training.

use crate::error::ParticipantError;
use crate::state_files::at;
use std::path::Path;
use zk0_argument::claim::Cost;
use zk0_circuits::{EvalSpec, Mode};
use zk0_prover::machine::{check_disk, check_memory, free_disk, Resources};
use zk0_weights::Format;

/// Checks the room for an update of this format in the node's state folder.
///
/// # Errors
/// The disk of the folder is too full.
pub fn check_room_of_update(format: &Format, state: &Path) -> Result<(), ParticipantError> {
    check_update(
        format.file_bytes(),
        state,
        free_disk(state).map_err(at(state))?,
    )
}

fn check_update(needed: u64, folder: &Path, free: u64) -> Result<(), ParticipantError> {
    if needed <= free {
        Ok(())
    } else {
        Err(ParticipantError::NoRoomForUpdate {
            folder: folder.into(),
            needed,
            free,
        })
    }
}

/// Checks the room for the argument that follows the training, also if the base saturates. Too little memory is a warning, because it may
/// be free by then.
///
/// # Errors
/// The disk of the node's state folder is too full.
pub fn check_room_of_argument(
    mode: Mode,
    spec: &EvalSpec,
    samples: u32,
    state: &Path,
) -> Result<(), ParticipantError> {
    if mode != Mode::Succinct {
        return Ok(());
    }
    let cost = Cost::of(spec, samples, true);
    check_disk(&cost, state, free_disk(state).map_err(at(state))?)?;
    match Resources::of_this_machine() {
        Ok(free) => {
            if let Err(lacking) = check_memory(&cost, free) {
                tracing::warn!(
                    "{lacking}; otherwise the system may end the node when it has trained"
                );
            }
        }
        Err(error) => tracing::warn!("{error}"),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_little_disk_for_an_update_says_how_much_is_needed_and_where() {
        let folder = Path::new("state");
        check_update(200_000_000, folder, 200_000_000).unwrap();
        let error = check_update(200_000_000, folder, 199_000_000).unwrap_err();
        let text = error.to_string();
        assert!(
            text.contains("200.0 MB of disk, and state has 199.0 MB free"),
            "{text}"
        );
    }
}
