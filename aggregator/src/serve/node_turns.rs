//! What a node asks for is done one request after the other. So when a node sends something again, because it has lost the connection, the second
//! request finds what the first one has recorded, and nothing is verified twice.
//!
//! A request that came after a deadline is recorded after all that came before it ([`crate::round::intake::arrivals`]). So it must not take its
//! node's turn before an earlier request of the same node: each of the two would wait for the other.

use crate::round::intake::arrivals::Arrivals;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use tokio::sync::{Mutex as Turn, OwnedMutexGuard};
use zk0_circuits::NodeId;

/// How many nodes are remembered before those that have no request in progress are forgotten.
const REMEMBERED: usize = 4096;

/// The nodes that have requests in progress.
#[derive(Clone, Default)]
pub(super) struct NodeTurns(Arc<Mutex<HashMap<NodeId, Weak<Turn<()>>>>>);

impl NodeTurns {
    /// Waits for the node's turn, which lasts until the guard is dropped. Only what the node has signed may wait: otherwise anybody could
    /// hold the node up.
    pub async fn take(&self, node: NodeId) -> OwnedMutexGuard<()> {
        self.of(node).lock_owned().await
    }

    /// The same for a request that is recorded after others. `passed` is the deadline after which it came, if there is one.
    pub async fn take_in_time(
        &self,
        node: NodeId,
        arrivals: &Arrivals,
        passed: Option<u64>,
    ) -> OwnedMutexGuard<()> {
        if let Some(deadline_ms) = passed {
            arrivals.done_by_node(deadline_ms, node).await;
        }
        self.take(node).await
    }

    fn of(&self, node: NodeId) -> Arc<Turn<()>> {
        let mut nodes = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if nodes.len() >= REMEMBERED {
            nodes.retain(|_, turn| turn.strong_count() > 0);
        }
        match nodes.get(&node).and_then(Weak::upgrade) {
            Some(turn) => turn,
            None => {
                let turn = Arc::new(Turn::new(()));
                nodes.insert(node, Arc::downgrade(&turn));
                turn
            }
        }
    }
}
