//! The client that waits for a proof, as a backend sees it.

use crate::rpc::progress::Phase;
use crate::rpc::ProveEvent;
use std::sync::atomic::{AtomicBool, Ordering};
use tokio::sync::{mpsc, watch};
use tonic::Status;

/// Why nobody waits for a proof any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GivenUp {
    /// The connection is closed.
    #[error("the client has gone")]
    ClientGone,
    /// The process has been told to end.
    #[error("the proving service is stopping")]
    Stopping,
}

/// The client that waits for a proof. A backend that can stop its work looks here whether it should.
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

    /// Ready as soon as nobody waits any more.
    pub async fn given_up(&self) -> GivenUp {
        tokio::select! {
            () = self.events.closed() => GivenUp::ClientGone,
            () = self.stopping() => GivenUp::Stopping,
        }
    }

    /// Ready as soon as the process has been told to end.
    pub async fn stopping(&self) {
        let mut stopping = self.stopping.clone();
        // An error says that the service itself is gone.
        let _ = stopping.wait_for(|stopping| *stopping).await;
    }

    /// Tells the client whether a prover is at work on its claim, or the claim still waits for one. Until a backend calls this, it is at work.
    pub fn taken(&self, taken: bool) {
        self.taken.store(taken, Ordering::Relaxed);
    }

    /// What the client is told.
    pub(super) fn phase(&self) -> Phase {
        if self.taken.load(Ordering::Relaxed) {
            Phase::Proving
        } else {
            Phase::Queued
        }
    }
}
