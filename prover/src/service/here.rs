//! The service's proofs from this machine.

use super::backend::JobError;
use crate::machine::{leftovers, Device, DeviceError, DeviceKind, LockError, ProverLock};
use crate::prove::Sp1Prover;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::OnceCell;

/// This machine's prover, started on first use.
pub(super) struct Here {
    device: Device,
    lock: Arc<ProverLock>,
    prover: OnceCell<Sp1Prover>,
}

/// Why this machine cannot prove now.
#[derive(Debug, thiserror::Error)]
pub enum HereError {
    /// No such device, or too little memory.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// Another prover runs.
    #[error(transparent)]
    Lock(#[from] LockError),
}

impl Here {
    /// Takes this machine's prover lock, removes killed provers' shared memory, and finds the device.
    pub fn find(device: DeviceKind) -> Result<Self, HereError> {
        let lock = ProverLock::acquire(&ProverLock::default_path(), Duration::ZERO)?;
        leftovers::remove(Path::new("/dev/shm"));
        let device = Device::find(device)?;
        Ok(Self {
            device,
            lock: Arc::new(lock),
            prover: OnceCell::new(),
        })
    }

    pub async fn prover(&self) -> Result<&Sp1Prover, JobError> {
        self.prover
            .get_or_try_init(|| Sp1Prover::start(self.device.clone(), self.lock.clone()))
            .await
            .map_err(JobError::failed)
    }
}
