//! The uploads in progress: one for each node. A newer upload of a node ends the one before, whose connection may be lost without anybody
//! having noticed.

use crate::round::request_error::RequestError;
use crate::turns::KeyedTurns;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::{watch, OwnedMutexGuard};
use zk0_circuits::NodeId;
use zk0_protocol::rpc::federation::turned_down::Remedy;

/// The uploads of all nodes.
#[derive(Clone, Default)]
pub(super) struct Uploads {
    turns: KeyedTurns<NodeId>,
    /// What the newest upload of each node holds the other end of. There are not more of them than members.
    newest: Arc<Mutex<HashMap<NodeId, watch::Sender<()>>>>,
}

/// An upload of a node, which is the newest one when it begins.
pub(super) struct Newest {
    node: NodeId,
    turns: KeyedTurns<NodeId>,
    newest: watch::Receiver<()>,
}

impl Uploads {
    /// Ends the upload of the node that is in progress.
    pub fn begin(&self, node: NodeId) -> Newest {
        let (ends, newest) = watch::channel(());
        // A panic elsewhere does not spoil the map: it is never half changed.
        let mut all = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        all.insert(node, ends);
        Newest {
            node,
            turns: self.turns.clone(),
            newest,
        }
    }
}

impl Newest {
    /// Waits until the upload before has written what has come of it. Nobody else writes for this node until the guard is dropped.
    pub async fn turn(&self) -> OwnedMutexGuard<()> {
        self.turns.take(self.node).await
    }

    /// Waits until a newer upload begins.
    pub async fn ended(&self) -> RequestError {
        let mut newest = self.newest.clone();
        while newest.changed().await.is_ok() {}
        let node = self.node;
        RequestError::Busy {
            why: format!("a newer upload of node {node} has begun, which ends this one"),
            remedy: Remedy::Never,
        }
    }
}
