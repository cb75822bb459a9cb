//! Starts SP1 on a device.

use super::cpu::Cpu;
#[cfg(feature = "cuda")]
use super::cuda::Cuda;
use super::interface::Engine;
use crate::machine::Device;

/// Starts SP1 on `device`. Takes minutes on few cores.
pub(crate) fn start(device: Device) -> Result<Box<dyn Engine>, String> {
    match device {
        Device::Cpu(options) => Ok(Box::new(Cpu::start(options))),
        #[cfg(feature = "cuda")]
        Device::Cuda(_) => Ok(Box::new(Cuda::start()?)),
    }
}
