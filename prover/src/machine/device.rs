//! Where SP1 proves: on this machine's CPU or GPU ([`crate::prove`]), or elsewhere ([`crate::network`]).

use super::device_error::DeviceError;
#[cfg(feature = "cuda")]
use super::gpu::Gpu;
use super::options::{ProverOptions, Resources};
use std::fmt;
use std::str::FromStr;

/// Where an operator wants to prove.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceKind {
    /// The CPU, in every build.
    #[default]
    Cpu,
    /// An NVIDIA GPU, in builds with the feature `cuda`.
    Cuda,
    /// Succinct's prover network, or an SP1 cluster, in builds with the feature `network`.
    Network,
}

/// The text names no device.
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

/// A device of this machine, with enough memory to start.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Device {
    /// The CPU, and SP1's options for it.
    Cpu(ProverOptions),
    /// The GPU. SP1 chooses its options.
    #[cfg(feature = "cuda")]
    Cuda(Gpu),
}

impl Device {
    /// Finds the device.
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

    /// The GPU memory in use, in bytes, also by other programs; `None` for a CPU. After a proof this is the peak, because SP1 keeps its
    /// memory.
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
