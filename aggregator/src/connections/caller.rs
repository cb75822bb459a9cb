//! The connection that a request came on, as the request sees it.

use crate::connections::places::{ConnectionSlots, Seat};
use std::sync::Arc;
use tokio::sync::{watch, Semaphore};
use zk0_circuits::NodeId;

/// A handle on a connection. Each request has it among its extensions. It outlives the connection.
#[derive(Clone)]
pub(crate) struct Caller {
    number: u64,
    places: Arc<ConnectionSlots>,
    /// For the requests of this connection that are in progress.
    pub(super) turns: Arc<Semaphore>,
    /// For the large messages of strangers at this address.
    pub(super) large: Arc<Semaphore>,
}

/// An answer with this extension says who sent the request. Whoever answers gives it only if the request's head shows that, and the sender
/// is a member: the connection is the sender's from then on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Author(pub NodeId);

/// Whether anybody waits for the answer to a request. Each request has it among its extensions, because it goes on when its caller has left.
#[derive(Clone)]
pub(crate) struct Awaited(watch::Receiver<()>);

impl Awaited {
    /// Somebody waits until the first of both is dropped.
    pub(super) fn begin() -> (watch::Sender<()>, Self) {
        let (waits, awaited) = watch::channel(());
        (waits, Self(awaited))
    }

    /// Ready when nobody waits any more.
    pub async fn no_more(mut self) {
        while self.0.changed().await.is_ok() {}
    }
}

/// A request in progress, until it is dropped.
pub(crate) struct InProgress(Caller);

impl Caller {
    /// The handle on the connection with this place, which may have `requests` in progress.
    pub fn new(seat: &Seat, requests: usize) -> Self {
        Self {
            number: seat.number,
            places: seat.places.clone(),
            turns: Arc::new(Semaphore::new(requests)),
            large: seat.large.clone(),
        }
    }

    /// Counts a request as in progress.
    pub fn begin(&self) -> InProgress {
        self.places.begin(self.number);
        InProgress(self.clone())
    }

    /// The connection is this node's from now on.
    pub fn is(&self, node: NodeId) {
        self.places.keep(self.number, node);
    }

    /// The turn for large messages of the node whose connection this is. `None` if it is a stranger's.
    pub(super) fn turn_of_node(&self) -> Option<Arc<Semaphore>> {
        self.places.turn_of_node(self.number)
    }

    /// Whether no node has shown on this connection who it is.
    pub fn is_stranger(&self) -> bool {
        self.places.node(self.number).is_none()
    }
}

impl Drop for InProgress {
    fn drop(&mut self) {
        self.0.places.end(self.0.number);
    }
}
