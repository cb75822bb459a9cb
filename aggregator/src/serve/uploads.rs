//! The uploads in progress: one for each node. A newer upload of a node ends the one before, whose connection may be lost without anybody
//! having noticed.

use crate::round::request_error::RequestError;
use crate::serve::node_turns::NodeTurns;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Notify, OwnedMutexGuard};
use zk0_circuits::NodeId;

/// The uploads of all nodes.
#[derive(Clone, Default)]
pub(super) struct Uploads {
    turns: NodeTurns,
    newest: Arc<Mutex<HashMap<NodeId, Arc<Notify>>>>,
}

/// The newest upload of a node, until it is dropped.
pub(super) struct Newest {
    node: NodeId,
    ended: Arc<Notify>,
    uploads: Uploads,
}

impl Uploads {
    /// Ends the upload of the node that is in progress.
    pub fn begin(&self, node: NodeId) -> Newest {
        let ended = Arc::new(Notify::new());
        if let Some(before) = self.newest().insert(node, ended.clone()) {
            before.notify_one();
        }
        Newest {
            node,
            ended,
            uploads: self.clone(),
        }
    }

    /// A panic elsewhere does not spoil the map: it is never half changed.
    fn newest(&self) -> MutexGuard<'_, HashMap<NodeId, Arc<Notify>>> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Newest {
    /// Waits until the upload before has written what has come of it. Nobody else writes for this node until the guard is dropped.
    pub async fn turn(&self) -> OwnedMutexGuard<()> {
        self.uploads.turns.take(self.node).await
    }

    /// Waits until a newer upload begins.
    pub async fn ended(&self) -> RequestError {
        self.ended.notified().await;
        let node = self.node;
        RequestError::Busy(format!(
            "a newer upload of node {node} has begun, which ends this one"
        ))
    }
}

impl Drop for Newest {
    fn drop(&mut self) {
        let mut newest = self.uploads.newest();
        let ours = newest.get(&self.node);
        if ours.is_some_and(|ours| Arc::ptr_eq(ours, &self.ended)) {
            newest.remove(&self.node);
        }
    }
}
