//! Errors about this machine's devices.

use super::options::OptionsError;

/// Why this machine cannot prove on the device.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// Too little free memory for a proof on the CPU.
    #[error(transparent)]
    Options(#[from] OptionsError),
    /// The build is for CPUs.
    #[error(
        "this build proves on the CPU only; `make cuda` makes one that proves on an NVIDIA GPU"
    )]
    NotBuilt,
    /// The network is no local device.
    #[error("the prover network is not a device of this machine: only `zk0 prover serve` has claims proven there")]
    Elsewhere,
    /// The build cannot ask the network.
    #[error(
        "this build proves on this machine only; `make network` makes one that has claims proven by Succinct's prover network or by \
         an SP1 cluster"
    )]
    NetworkNotBuilt,
    /// No GPU, or its driver is too old.
    #[error(
        "no GPU can be used: {0}; `nvidia-smi` must show a GPU, and a CUDA version not older than the one this program was \
         built with"
    )]
    NoGpu(String),
    /// Too little free GPU memory.
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
    /// Too little free memory of the machine itself.
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
