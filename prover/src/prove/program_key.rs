//! Checks a program's verifying key before proofs.

use crate::program::VerifyingKey;
use sp1_sdk::{ProvingKey, SP1ProvingKey};

/// Verifiers expect another program than the ELF.
#[derive(Debug, thiserror::Error)]
#[error("the guest ELF has another verifying key ({found}) than the one recorded with it: run `make guest`, which builds and records both")]
pub struct OtherProgram {
    /// Its `bytes32`.
    pub found: String,
}

/// Checks that a program has the verifying key `expected`.
pub(crate) fn check_program(
    program: &SP1ProvingKey,
    expected: &[u8; 32],
) -> Result<(), OtherProgram> {
    match VerifyingKey::of(program.verifying_key()) {
        Ok(key) if key.koalabear == expected => Ok(()),
        Ok(key) => Err(OtherProgram { found: key.bytes32 }),
        Err(error) => Err(OtherProgram {
            found: error.to_string(),
        }),
    }
}
