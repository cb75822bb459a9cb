//! What SP1 proves on: this machine's CPU or its GPU, or machines of others. A device of this machine is found here; [`crate::prove`] starts
//! SP1 on it. [`crate::network`] is for the machines of others.

use super::device_error::DeviceError;
#[cfg(feature = "cuda")]
use super::gpu::Gpu;
use super::options::{ProverOptions, Resources};
use std::fmt;
use std::str::FromStr;

/// What an operator asks to prove on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceKind {
    /// The CPU. Every build can prove on it.
    #[default]
    Cpu,
    /// An NVIDIA GPU. Only builds with the feature `cuda` can prove on it.
    Cuda,
    /// Succinct's prover network, or an SP1 cluster. Only builds with the feature `network` can ask them.
    Network,
}

/// The text does not name a device.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is not a device that can prove: write cpu, cuda or network")]
pub struct UnknownDevice(String);

impl FromStr for DeviceKind {
    type Err = UnknownDevice;

    fn from_str(text: &str) -> Result<Self, UnknownDevice> {
        match text {
            "cpu" => Ok(Self::Cpu),
            "cuda" => Ok(Self::Cuda),
            "network" => Ok(Self::Network),
            _ => Err(UnknownDevice(text.into())),
        }
    }
}

impl fmt::Display for DeviceKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cpu => "cpu",
            Self::Cuda => "cuda",
            Self::Network => "network",
        })
    }
}

/// A device that this machine has, with memory enough to start.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Device {
    /// The CPU, and how SP1 is to use it.
    Cpu(ProverOptions),
    /// The GPU. SP1 chooses how to use it.
    #[cfg(feature = "cuda")]
    Cuda(Gpu),
}

impl Device {
    /// Finds the device on this machine.
    pub fn find(kind: DeviceKind) -> Result<Self, DeviceError> {
        let host = Resources::of_this_machine()?;
        match kind {
            DeviceKind::Cpu => Ok(Self::Cpu(ProverOptions::choose(host)?)),
            #[cfg(feature = "cuda")]
            DeviceKind::Cuda => Ok(Self::Cuda(Gpu::find(host)?)),
            #[cfg(not(feature = "cuda"))]
            DeviceKind::Cuda => Err(DeviceError::NotBuilt),
            DeviceKind::Network => Err(DeviceError::Elsewhere),
        }
    }

    /// The GPU memory in use, in bytes; `None` for a CPU. After a proof this is the most that the proof took, because SP1 keeps its
    /// memory while the process lives. The memory of other programs counts too.
    pub fn gpu_memory_used(&self) -> Option<u64> {
        match self {
            Self::Cpu(_) => None,
            #[cfg(feature = "cuda")]
            Self::Cuda(gpu) => gpu.memory_used(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_is_known_by_its_name() {
        for kind in [DeviceKind::Cpu, DeviceKind::Cuda, DeviceKind::Network] {
            assert_eq!(kind.to_string().parse(), Ok(kind));
        }
        let error = "gpu".parse::<DeviceKind>().unwrap_err();
        assert!(error.to_string().contains("'gpu'"), "{error}");
    }

    #[cfg(not(feature = "cuda"))]
    #[test]
    fn a_build_without_the_feature_says_how_to_get_one_with_it() {
        let error = Device::find(DeviceKind::Cuda).unwrap_err();
        assert!(error.to_string().contains("make cuda"), "{error}");
    }
}
