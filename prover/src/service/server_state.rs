//! What the requests of a proving service share.

use super::backend::{Backend, JobError};
use super::made::Made;
use super::metrics::ProverMetrics;
use super::schedule::{Pace, ProofQueue};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{watch, OwnedSemaphorePermit, Semaphore};

/// MiB for all requests' private inputs.
pub(super) const MEMORY_MIB: u32 = 4 << 10;

pub(super) struct ServerState<B> {
    pub backend: B,
    /// Requests served or waiting: one, and the queue's length. A present proof, or one in progress, needs no slot.
    slots: Arc<Semaphore>,
    /// The rest of [`MEMORY_MIB`].
    pub memory: Arc<Semaphore>,
    /// One check at a time.
    pub checking: Semaphore,
    /// One proof at a time, in order.
    pub proving: Arc<Semaphore>,
    schedule: Mutex<ProofQueue>,
    pub made: Made,
    /// Whether the process has to end.
    pub stopping: watch::Sender<bool>,
    pub metrics: ProverMetrics,
}

impl<B: Backend> ServerState<B> {
    /// While one request is proven, at most `queue` others wait.
    pub fn new(backend: B, queue: usize, pace: Pace) -> Self {
        let metrics = ProverMetrics::default();
        let schedule = ProofQueue::new(pace).counted(metrics.queue.clone());
        Self {
            backend,
            slots: Arc::new(Semaphore::new(queue + 1)),
            memory: Arc::new(Semaphore::new(MEMORY_MIB as usize)),
            checking: Semaphore::new(1),
            proving: Arc::new(Semaphore::new(1)),
            schedule: Mutex::new(schedule),
            made: Made::default(),
            stopping: watch::Sender::new(false),
            metrics,
        }
    }
}

impl<B> ServerState<B> {
    pub fn schedule(&self) -> MutexGuard<'_, ProofQueue> {
        // The lock's holders do not panic, and a panic would leave the figures right.
        self.schedule.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn slot(&self) -> Result<OwnedSemaphorePermit, JobError> {
        let slot = self.slots.clone().try_acquire_owned();
        slot.map_err(|_| JobError::QueueFull)
    }
}
