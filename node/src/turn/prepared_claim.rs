//! Prepares a claim for the proving service: in mode `succinct`, minutes of work before SP1 starts.

use crate::error::ParticipantError;
use crate::progress::Progress;
use crate::recording::opened_samples::OpenedSamples;
use crate::recording::secret::{count, RegistrationSecret};
use std::panic::resume_unwind;
use std::path::PathBuf;
use tokio::task::spawn_blocking;
use tracing::instrument;
use zk0_argument::claim::{most_uses, ClaimSource};
use zk0_circuits::Mode;
use zk0_prover::program::PreparedClaim;
use zk0_smolvla::policy::memory::KeepFreed;

const UNITS: f64 = 1000.0;

/// Prepares the claim that `input` proves, on a thread of its own, so that the node's connections stay alive. Files in the state folder
/// `state` hold values of samples meanwhile. `secret` hides the samples. In mode `succinct` the argument is counted before it is made.
///
/// # Errors
/// The claim does not hold, or cannot be proven in this mode. The argument cannot be counted: a sample is worn out, or the file fails.
#[instrument(name = "make the argument", skip_all)]
pub async fn prepare(
    mode: Mode,
    input: OpenedSamples,
    secret: RegistrationSecret,
    state: PathBuf,
) -> Result<PreparedClaim, ParticipantError> {
    let prepared = spawn_blocking(move || {
        if mode == Mode::Succinct {
            let leaves: Vec<_> = input.places().iter().map(|(leaf, _)| *leaf).collect();
            count(&state, &secret, &leaves, most_uses(&input.header().spec))?;
        }
        // The argument's steps free gigabytes and allocate as much again.
        let _memory = KeepFreed::new();
        let mut progress = Progress::start("making the argument", UNITS as u64);
        let tell = &mut |share| progress.reached((UNITS * share) as u64);
        Ok(PreparedClaim::of(
            mode,
            &input,
            &secret.blind(),
            Some(&state),
            tell,
        )?)
    });
    match prepared.await {
        Ok(prepared) => prepared,
        Err(panicked) => resume_unwind(panicked.into_panic()),
    }
}
