//! SP1 on an NVIDIA GPU, in this process. Not yet run on a GPU.

use super::interface::ProverEngine;
use sp1_core_executor::SP1Context;
use sp1_gpu_cudart::run_in_place;
use sp1_gpu_prover::cuda_worker_builder;
use sp1_prover::worker::{SP1LocalNode, SP1LocalNodeBuilder};
use sp1_sdk::{Elf, ProvingKey, SP1ProofWithPublicValues, SP1ProvingKey, SP1Stdin};
use std::future;
use std::mem::ManuallyDrop;
use tokio::runtime::Runtime;
use tokio::sync::oneshot;

pub(crate) struct Cuda {
    node: SP1LocalNode,
    /// Runs SP1's tasks, some of which work long between awaits, apart from the caller's. Never shut down: SP1's GPU data refer to a task
    /// scope without holding it, so the scope must outlive them.
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
            // The scope ended before it had a node: SP1 panics when it cannot continue.
            Err(_) => Err(match runtime.block_on(scope) {
                Err(panic) => panic.to_string(),
                Ok(()) => "it ended without a reason".into(),
            }),
        }
    }
}

impl ProverEngine for Cuda {
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
