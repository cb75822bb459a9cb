//! Prepares a claim for the proving service: what takes minutes on this machine in mode `succinct`, before SP1 starts.

use crate::error::ParticipantError;
use crate::progress::Progress;
use crate::recording::opened_samples::OpenedSamples;
use std::panic::resume_unwind;
use std::path::PathBuf;
use tokio::task::spawn_blocking;
use tracing::instrument;
use zk0_circuits::Mode;
use zk0_prover::program::Prepared;

/// Units of the progress that is reported.
const UNITS: f64 = 1000.0;

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
