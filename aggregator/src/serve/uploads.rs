//! The uploads in progress: one for each node. A newer upload ends the one before, whose connection may be lost unnoticed.

use crate::round::request_error::RequestError;
use crate::turns::KeyedTurns;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::{watch, OwnedMutexGuard};
use zk0_circuits::NodeId;
use zk0_protocol::rpc::federation::turned_down::Remedy;

#[derive(Clone, Default)]
pub(super) struct Uploads {
    turns: KeyedTurns<NodeId>,
    /// The other end of what each node's newest upload holds. All are members.
    newest: Arc<Mutex<HashMap<NodeId, watch::Sender<()>>>>,
}

pub(super) struct Newest {
    node: NodeId,
    turns: KeyedTurns<NodeId>,
    newest: watch::Receiver<()>,
}

impl Uploads {
    /// Ends the node's upload in progress.
    pub fn begin(&self, node: NodeId) -> Newest {
        let (ends, newest) = watch::channel(());
        // A panic elsewhere leaves the map whole.
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
    /// Waits until the upload before has written what has come. Until the guard is dropped, no other task writes for this node.
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
