//! Prepares a claim for the proving service: what takes minutes on this machine in mode `succinct`, before SP1 starts.

use crate::error::ParticipantError;
use crate::progress::Progress;
use crate::recording::opened_samples::OpenedSamples;
use crate::state_files::at;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use tokio::task::spawn_blocking;
use tracing::instrument;
use zk0_argument::claim::Cost;
use zk0_circuits::{EvalSpec, Mode};
use zk0_prover::machine::{check_disk, check_memory, free_disk, Resources};
use zk0_prover::program::Prepared;

/// Units of the progress that is reported.
const UNITS: f64 = 1000.0;

/// Checks, before the node trains, that this machine has room for what [`prepare`] does in this mode. Too little memory is a warning, because it
/// may be free by then.
///
/// # Errors
/// The disk of the node's state folder is too full, or the evaluation is too small for this mode.
pub fn check_room(
    mode: Mode,
    spec: &EvalSpec,
    samples: u32,
    state: &Path,
) -> Result<(), ParticipantError> {
    if mode != Mode::Succinct {
        return Ok(());
    }
    let cost = Cost::of(spec, samples)?;
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

/// Prepares the claim that `input` proves, and reports how far it is. It computes on a thread of its own, so that the connections of the node
/// stay alive. `state` is the node's state folder: values of samples are in files there meanwhile.
///
/// # Errors
/// The claim does not hold, or cannot be proven in this mode.
#[instrument(name = "make the argument", skip_all)]
pub async fn prepare(
    mode: Mode,
    input: OpenedSamples,
    state: PathBuf,
) -> Result<Prepared, ParticipantError> {
    let prepared = spawn_blocking(move || {
        let mut progress = Progress::start("making the argument", UNITS as u64);
        Prepared::of(mode, &input, Some(&state), &mut |share| {
            progress.reached((UNITS * share) as u64);
        })
    });
    match prepared.await {
        Ok(prepared) => Ok(prepared?),
        Err(panicked) => resume_unwind(panicked.into_panic()),
    }
}
