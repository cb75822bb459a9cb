//! Why this machine cannot prove on a device.

use super::options::OptionsError;

/// Why this machine cannot prove on the device.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// Too little memory is free for a proof on the CPU.
    #[error(transparent)]
    Options(#[from] OptionsError),
    /// The program was built for CPUs.
    #[error(
        "this build proves on the CPU only; `make cuda` makes one that proves on an NVIDIA GPU"
    )]
    NotBuilt,
    /// The network is no device of a machine.
    #[error("the prover network is not a device of this machine: only `zk0 prover serve` has claims proven there")]
    Elsewhere,
    /// The program was built without the code that asks the network.
    #[error(
        "this build proves on this machine only; `make network` makes one that has claims proven by Succinct's prover network or by \
         an SP1 cluster"
    )]
    NetworkNotBuilt,
    /// There is no GPU, or its driver is too old.
    #[error(
        "no GPU can be used: {0}; `nvidia-smi` must show a GPU, and a CUDA version not older than the one this program was \
         built with"
    )]
    NoGpu(String),
    /// The GPU has too little free memory.
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
    /// This machine has too little free memory of its own.
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
