//! SP1 on an NVIDIA GPU, within this process. Not yet run on a GPU.

use super::Engine;
use crate::{device::DeviceError, options::Resources};
use sp1_core_executor::SP1Context;
use sp1_gpu_cudart::{cuda_device_name, cuda_memory_info, run_in_place};
use sp1_gpu_prover::{
    cuda_worker_builder, local_gpu_opts, RECURSION_TRACE_ALLOCATION, SHRINK_TRACE_ALLOCATION,
    WRAP_TRACE_ALLOCATION,
};
use sp1_prover::{
    worker::{SP1LocalNode, SP1LocalNodeBuilder},
    CORE_LOG_STACKING_HEIGHT,
};
use sp1_sdk::{Elf, ProvingKey, SP1ProofWithPublicValues, SP1ProvingKey, SP1Stdin};
use std::{future, mem::ManuallyDrop};
use tokio::{runtime::Runtime, sync::oneshot};

const GIB: u64 = 1 << 30;

/// Free GPU memory that proving needs, in GiB. SP1 panics on GPUs of less than 24 GB, by which it means more than 19 GiB.
const NEEDED_GIB: u64 = 20;

/// The first GPU of this machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Gpu {
    /// As its driver calls it.
    pub name: String,
    /// Its memory, in bytes.
    pub memory: u64,
}

impl Gpu {
    /// Finds it, and memory enough to start: on the GPU what SP1 asks for, on `host` what SP1 locks for traces. A proof
    /// takes more of `host`; how much is not known yet, so that is left to the operator.
    pub(crate) fn find(host: Resources) -> Result<Self, DeviceError> {
        let none = |error: sp1_gpu_cudart::CudaError| DeviceError::NoGpu(error.to_string());
        let (free, total) = cuda_memory_info().map_err(none)?;
        let name = cuda_device_name().map_err(none)?.to_owned();
        // Rounded up, as SP1 does: a card sold as 24 GB has some MiB less.
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

/// Host memory that `cuda_worker_builder` locks, in bytes: four buffers of field elements for each of four provers. Call it
/// once the GPU's memory is known to do.
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

pub(crate) struct Cuda {
    node: SP1LocalNode,
    /// SP1's tasks run here, apart from those of the caller: some work long between two awaits. Never shut down, for what
    /// SP1 keeps on the GPU refers to a task scope without holding it: the scope has to stay as long as anything uses it.
    runtime: ManuallyDrop<Runtime>,
}

impl Cuda {
    pub(crate) fn start() -> Result<Self, String> {
        let runtime = ManuallyDrop::new(Runtime::new().map_err(|error| error.to_string())?);
        let (hand_out, handed_out) = oneshot::channel();
        let scope = runtime.spawn(async move {
            run_in_place(|scope| async move {
                let builder = cuda_worker_builder(scope).await;
                let node = SP1LocalNodeBuilder::from_worker_client_builder(builder).build();
                if hand_out.send(node.await).is_ok() {
                    future::pending::<()>().await;
                }
            })
            .await;
        });
        match runtime.block_on(handed_out) {
            Ok(Ok(node)) => Ok(Self { node, runtime }),
            Ok(Err(error)) => Err(format!("{error:#}")),
            // The scope ended before it had a node: SP1 panics where it knows no way on.
            Err(_) => Err(match runtime.block_on(scope) {
                Err(panic) => panic.to_string(),
                Ok(()) => "it ended without a reason".into(),
            }),
        }
    }
}

impl Engine for Cuda {
    fn setup(&self, elf: &'static [u8]) -> Result<SP1ProvingKey, String> {
        let key = self
            .runtime
            .block_on(self.node.setup(elf))
            .map_err(|error| format!("{error:#}"))?;
        Ok(SP1ProvingKey::new(key, Elf::Static(elf)))
    }

    fn prove(
        &self,
        program: &SP1ProvingKey,
        stdin: SP1Stdin,
    ) -> Result<SP1ProofWithPublicValues, String> {
        // SP1's `prove` makes compressed proofs.
        let proof = self.node.prove(program.elf(), stdin, SP1Context::default());
        let proof = self.runtime.block_on(proof);
        proof.map(Into::into).map_err(|error| format!("{error:#}"))
    }
}
