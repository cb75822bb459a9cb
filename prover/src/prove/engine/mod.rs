//! One interface to SP1 on the CPU or a GPU.

mod cpu;
#[cfg(feature = "cuda")]
mod cuda;
mod interface;

use crate::machine::Device;

pub(crate) use interface::ProverEngine;

/// Starts SP1 on `device`, in minutes on few cores.
pub(crate) fn start(device: Device) -> Result<Box<dyn ProverEngine>, String> {
    match device {
        Device::Cpu(options) => Ok(Box::new(cpu::Cpu::start(options))),
        #[cfg(feature = "cuda")]
        Device::Cuda(_) => Ok(Box::new(cuda::Cuda::start()?)),
    }
}
