//! SP1 behind one door, wherever it runs. Blocks: [`crate::prove`] calls it on threads where it may.

mod cpu;
#[cfg(feature = "cuda")]
pub(crate) mod cuda;

use crate::device::Device;
use sp1_sdk::{SP1ProofWithPublicValues, SP1ProvingKey, SP1Stdin};

/// SP1, started on a device. Errors are what SP1 said.
pub(crate) trait Engine: Send + Sync {
    /// Derives the keys of a program. Seconds.
    fn setup(&self, elf: &'static [u8]) -> Result<SP1ProvingKey, String>;

    /// Makes a compressed proof.
    fn prove(
        &self,
        program: &SP1ProvingKey,
        stdin: SP1Stdin,
    ) -> Result<SP1ProofWithPublicValues, String>;
}

/// Starts SP1 on `device`. Minutes on few cores.
pub(crate) fn start(device: Device) -> Result<Box<dyn Engine>, String> {
    match device {
        Device::Cpu(options) => Ok(Box::new(cpu::Cpu::start(options))),
        #[cfg(feature = "cuda")]
        Device::Cuda(_) => Ok(Box::new(cuda::Cuda::start()?)),
    }
}
