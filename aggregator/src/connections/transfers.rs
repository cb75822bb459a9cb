//! How many files are sent and received at once. Each stays open as long as its peer takes, so there are as many as connections: an eighth
//! for downloads of strangers, the rest for nodes.

use std::sync::Arc;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

#[derive(Clone)]
pub(crate) struct Transfers {
    nodes: Arc<Semaphore>,
    strangers: Arc<Semaphore>,
}

impl Transfers {
    /// As many places as connections, at least one of each kind.
    pub fn new(connections: usize) -> Self {
        let strangers = connections.div_ceil(8);
        let places = |places: usize| {
            let places = places.clamp(1, Semaphore::MAX_PERMITS);
            Arc::new(Semaphore::new(places))
        };
        Self {
            nodes: places(connections - strangers),
            strangers: places(strangers),
        }
    }

    /// A place for a file, until it is dropped. `None` if all are taken.
    pub fn begin(&self, of_node: bool) -> Option<OwnedSemaphorePermit> {
        let places = if of_node {
            &self.nodes
        } else {
            &self.strangers
        };
        places.clone().try_acquire_owned().ok()
    }
}
