//! What every engine can do. Its functions block: [`crate::prove`] calls them on threads that may block.

use sp1_sdk::{SP1ProofWithPublicValues, SP1ProvingKey, SP1Stdin};

/// SP1, started on a device. Errors are what SP1 said.
pub(crate) trait ProverEngine: Send + Sync {
    /// Derives the keys of a program. Takes seconds.
    fn setup(&self, elf: &'static [u8]) -> Result<SP1ProvingKey, String>;

    /// Makes a compressed proof.
    fn prove(
        &self,
        program: &SP1ProvingKey,
        stdin: SP1Stdin,
    ) -> Result<SP1ProofWithPublicValues, String>;
}
