//! How many files are sent and received at once. Each is an open file for as long as its peer takes, so there are as many as connections,
//! and the system is asked for as many open files.
//!
//! | whose | places |
//! |---|---|
//! | nodes: what they download and upload | as many as nodes keep connections |
//! | strangers: what they download | as many as there are other connections |

use crate::connections::limits::ConnectionLimits;
use std::sync::Arc;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Places for files that are being sent and received.
#[derive(Clone)]
pub(crate) struct Transfers {
    nodes: Arc<Semaphore>,
    strangers: Arc<Semaphore>,
}

/// A file's place, until it is dropped.
pub(crate) struct Transfer {
    _place: OwnedSemaphorePermit,
}

impl Transfers {
    /// As many places as `limits` allow connections. There is always one for a node.
    pub fn new(limits: &ConnectionLimits) -> Self {
        let of_nodes = limits.most_of_nodes();
        let places = |places: usize| Arc::new(Semaphore::new(places.min(Semaphore::MAX_PERMITS)));
        Self {
            nodes: places(of_nodes.max(1)),
            strangers: places(limits.most - of_nodes),
        }
    }

    /// A place for a file of a node, or else of a stranger. `None` if all are taken.
    pub fn begin(&self, of_node: bool) -> Option<Transfer> {
        let places = if of_node {
            &self.nodes
        } else {
            &self.strangers
        };
        let place = places.clone().try_acquire_owned().ok()?;
        Some(Transfer { _place: place })
    }
}
