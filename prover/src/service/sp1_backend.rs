//! SP1 on this machine as the backend of the proving service.

use super::backend::{Backend, JobError};
use crate::machine::{leftovers, Device, DeviceError, DeviceKind, LockError, ProverLock};
use crate::program::{elf, ExecuteError, Execution, Executor, GuestInput};
use crate::prove::{Proof, Sp1Prover};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::OnceCell;
use zk0_circuits::Claim;

/// Executes with SP1's executor, and proves with the one prover of this machine.
pub struct Sp1Backend {
    executor: Executor,
    device: Device,
    lock: Arc<ProverLock>,
    prover: OnceCell<Sp1Prover>,
}

/// Why this machine cannot prove now.
#[derive(Debug, thiserror::Error)]
pub enum Sp1BackendError {
    /// The machine lacks the device, or memory.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// Another prover runs.
    #[error(transparent)]
    Lock(#[from] LockError),
    /// SP1's executor did not start.
    #[error(transparent)]
    Executor(#[from] ExecuteError),
}

impl Sp1Backend {
    /// Takes this machine's prover lock, removes what killed provers left in memory, and finds the device. SP1 itself starts when the service starts.
    pub async fn new(device: DeviceKind) -> Result<Self, Sp1BackendError> {
        let lock = ProverLock::acquire(&ProverLock::default_path(), Duration::ZERO)?;
        leftovers::remove(Path::new("/dev/shm"));
        let device = Device::find(device)?;
        Ok(Self {
            executor: Executor::new().await?,
            device,
            lock: Arc::new(lock),
            prover: OnceCell::new(),
        })
    }

    async fn prover(&self) -> Result<&Sp1Prover, JobError> {
        self.prover
            .get_or_try_init(|| Sp1Prover::start(self.device.clone(), self.lock.clone()))
            .await
            .map_err(failed)
    }
}

#[tonic::async_trait]
impl Backend for Sp1Backend {
    async fn start(&self) -> Result<(), JobError> {
        self.prover().await.map(|_| ())
    }

    async fn check(&self, input: &GuestInput) -> Result<Execution, JobError> {
        // The native check comes first: it takes a moment, and gives the reason in full.
        let claim = input.claim()?;
        let execution = self
            .executor
            .execute(elf(input.mode), &input.buffers)
            .await
            .map_err(failed)?;
        match borsh::from_slice::<Claim>(&execution.public_values) {
            Ok(proven) if proven == claim => Ok(execution),
            _ => Err(JobError::Failed(
                "the guest program commits to another claim than the statement gives here".into(),
            )),
        }
    }

    async fn prove(&self, input: &GuestInput) -> Result<Proof, JobError> {
        self.prover()
            .await?
            .prove_compressed(input)
            .await
            .map_err(failed)
    }
}

fn failed(error: impl ToString) -> JobError {
    JobError::Failed(error.to_string())
}
