//! What every engine does. Its functions block, so call them on threads that may.

use sp1_sdk::{SP1ProofWithPublicValues, SP1ProvingKey, SP1Stdin};

/// Errors are SP1's messages.
pub(crate) trait ProverEngine: Send + Sync {
    /// Derives a program's keys, in seconds.
    fn setup(&self, elf: &'static [u8]) -> Result<SP1ProvingKey, String>;

    fn prove(
        &self,
        program: &SP1ProvingKey,
        stdin: SP1Stdin,
    ) -> Result<SP1ProofWithPublicValues, String>;
}
