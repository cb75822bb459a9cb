//! The client that waits for a proof, for a backend.

use crate::rpc::progress::Phase;
use crate::rpc::ProveEvent;
use std::sync::atomic::{AtomicBool, Ordering};
use tokio::sync::{mpsc, watch};
use tonic::Status;

/// Why waiting ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GivenUp {
    /// The connection closed.
    #[error("the client has gone")]
    ClientGone,
    /// The process has to end.
    #[error("the proving service is stopping")]
    Stopping,
}

/// The client that waits for a proof. A backend that can stop its work asks this whether to stop.
pub struct WaitingClient {
    events: mpsc::Sender<Result<ProveEvent, Status>>,
    stopping: watch::Receiver<bool>,
    taken: AtomicBool,
}

impl WaitingClient {
    pub(super) fn new(
        events: mpsc::Sender<Result<ProveEvent, Status>>,
        stopping: watch::Receiver<bool>,
    ) -> Self {
        Self {
            events,
            stopping,
            taken: AtomicBool::new(true),
        }
    }

    /// Ready when waiting has ended.
    pub async fn given_up(&self) -> GivenUp {
        tokio::select! {
            () = self.events.closed() => GivenUp::ClientGone,
            () = self.stopping() => GivenUp::Stopping,
        }
    }

    /// Ready when the process has to end.
    pub async fn stopping(&self) {
        let mut stopping = self.stopping.clone();
        // An error means that the service is gone.
        let _ = stopping.wait_for(|stopping| *stopping).await;
    }

    /// Tells the client whether a prover works on its claim, or the claim waits. By default, a prover works on it.
    pub fn taken(&self, taken: bool) {
        self.taken.store(taken, Ordering::Relaxed);
    }

    pub(super) fn phase(&self) -> Phase {
        if self.taken.load(Ordering::Relaxed) {
            Phase::Proving
        } else {
            Phase::Queued
        }
    }
}
