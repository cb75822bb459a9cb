//! What SP1 proves on: this machine's CPU or its GPU. Found here, before anything takes minutes; [`crate::prove`] starts it.

use crate::options::{OptionsError, ProverOptions, Resources};
use std::{fmt, str::FromStr};

#[cfg(feature = "cuda")]
use crate::engine::cuda::Gpu;

/// What an operator asks to prove on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceKind {
    /// The CPU. Every build can.
    #[default]
    Cpu,
    /// An NVIDIA GPU, by a build with the feature `cuda`.
    Cuda,
}

/// It names no device.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is no device to prove on; there are cpu and cuda")]
pub struct UnknownDevice(String);

impl FromStr for DeviceKind {
    type Err = UnknownDevice;

    fn from_str(text: &str) -> Result<Self, UnknownDevice> {
        match text {
            "cpu" => Ok(Self::Cpu),
            "cuda" => Ok(Self::Cuda),
            _ => Err(UnknownDevice(text.into())),
        }
    }
}

impl fmt::Display for DeviceKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cpu => "cpu",
            Self::Cuda => "cuda",
        })
    }
}

/// A device of this machine that is there, with memory enough to start.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Device {
    /// The CPU, and how SP1 shall use it.
    Cpu(ProverOptions),
    /// The GPU. How to use it is SP1's choice.
    #[cfg(feature = "cuda")]
    Cuda(Gpu),
}

/// Why this machine cannot prove on the device.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// Too little memory for the CPU.
    #[error(transparent)]
    Options(#[from] OptionsError),
    /// The program was built for CPUs.
    #[error(
        "this build proves on the CPU only; `make cuda` makes one that proves on an NVIDIA GPU"
    )]
    NotBuilt,
    /// There is no GPU, or no driver that is recent enough.
    #[error(
        "no GPU can be used: {0}; `nvidia-smi` must show one, and a CUDA version not older than the one this program was \
         built with"
    )]
    NoGpu(String),
    /// The GPU's memory would not do.
    #[error(
        "proving needs {needed} GiB of free GPU memory, and {name} has {free} GiB free: end other programs on it, or prove on \
         another GPU"
    )]
    SmallGpu {
        /// The GPU's name.
        name: String,
        /// GiB needed.
        needed: u64,
        /// GiB free.
        free: u64,
    },
    /// This machine's own memory would not do.
    #[error(
        "to prove on a GPU, SP1 first locks {needed} GiB of this machine's own memory, and {free} GiB are free: close other \
         programs, or prove on another machine"
    )]
    LittleHostMemory {
        /// GiB needed to start.
        needed: u64,
        /// GiB free.
        free: u64,
    },
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
        }
    }

    /// GPU memory in use, in bytes: after a proof, the most that it took, for SP1 gives none back while the process lives.
    /// Other programs' memory counts too. `None` of a CPU.
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
        for kind in [DeviceKind::Cpu, DeviceKind::Cuda] {
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
