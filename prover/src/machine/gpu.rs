//! This machine's NVIDIA GPU, if its memory suffices. Not yet run on a GPU.

use super::device_error::DeviceError;
use super::options::Resources;
use sp1_gpu_cudart::{cuda_device_name, cuda_memory_info};
use sp1_gpu_prover::{
    local_gpu_opts, RECURSION_TRACE_ALLOCATION, SHRINK_TRACE_ALLOCATION, WRAP_TRACE_ALLOCATION,
};
use sp1_prover::CORE_LOG_STACKING_HEIGHT;

const GIB: u64 = 1 << 30;

/// Free GPU memory for proving, in GiB. SP1 panics below 24 GB, by which it means 19 GiB or less.
const NEEDED_GIB: u64 = 20;

/// This machine's first GPU.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Gpu {
    /// The driver's name for it.
    pub name: String,
    /// The memory, in bytes.
    pub memory: u64,
}

impl Gpu {
    /// Finds the GPU, and checks the memory to start: on the GPU what SP1 requires, on `host` what SP1 locks for traces. A proof takes more
    /// of `host`, not yet measured, so the operator must ensure it.
    pub(crate) fn find(host: Resources) -> Result<Self, DeviceError> {
        let none = |error: sp1_gpu_cudart::CudaError| DeviceError::NoGpu(error.to_string());
        let (free, total) = cuda_memory_info().map_err(none)?;
        let name = cuda_device_name().map_err(none)?.to_owned();
        // Rounded up, as in SP1, because a card sold as 24 GB has some MiB less.
        let free = (free as u64).div_ceil(GIB);
        if free < NEEDED_GIB {
            return Err(DeviceError::SmallGpu {
                name,
                needed: NEEDED_GIB,
                free,
            });
        }
        let locked = locked_memory();
        if host.memory < locked {
            return Err(DeviceError::LittleHostMemory {
                needed: locked.div_ceil(GIB),
                free: host.memory / GIB,
            });
        }
        let memory = total as u64;
        Ok(Self { name, memory })
    }

    pub(crate) fn memory_used(&self) -> Option<u64> {
        let (free, total) = cuda_memory_info().ok()?;
        Some(total.saturating_sub(free) as u64)
    }
}

/// Host memory that `cuda_worker_builder` locks, in bytes: four buffers of field elements for each of four provers. Check the GPU's memory
/// before.
fn locked_memory() -> u64 {
    let core = local_gpu_opts().sharding_threshold.element_threshold as usize
        + (1 << CORE_LOG_STACKING_HEIGHT);
    let provers = [
        core,
        RECURSION_TRACE_ALLOCATION,
        SHRINK_TRACE_ALLOCATION,
        WRAP_TRACE_ALLOCATION,
    ];
    let buffers_of_each = 4;
    (provers.iter().sum::<usize>() * buffers_of_each * size_of::<u32>()) as u64
}
