//! Which nodes are present: those that follow the rounds with a signed `WatchRound`, as a waiting node does, or did so within a minute.
//!
//! Only the aggregator sees this, so the ledger does not depend on it. Rules that ask for present nodes bind the aggregator alone. A replay
//! checks only the number of nodes. An aggregator that breaks the rule opens a round with fewer contributions, as everybody sees.

use crate::clock::Clock;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use zk0_circuits::NodeId;

/// How long a node stays present after a `WatchRound`. That ends every five minutes, and the node asks again within a second, or when its
/// connection is back.
pub const AFTERWARDS: Duration = Duration::from_secs(60);

/// The nodes seen, all of them members.
pub struct Presence {
    clock: Arc<dyn Clock>,
    nodes: Mutex<HashMap<NodeId, LastSeen>>,
}

#[derive(Default)]
struct LastSeen {
    /// By so many open requests.
    following: usize,
    /// When the last one ended, by the steady clock.
    last: Duration,
}

/// A node follows the rounds until this is dropped.
pub struct Following {
    node: NodeId,
    all: Arc<Presence>,
}

impl Presence {
    /// No nodes seen yet.
    pub fn new(clock: Arc<dyn Clock>) -> Self {
        Self {
            clock,
            nodes: Mutex::default(),
        }
    }

    /// A member follows the rounds from now on.
    pub fn follow(self: &Arc<Self>, node: NodeId) -> Following {
        self.nodes().entry(node).or_default().following += 1;
        Following {
            node,
            all: self.clone(),
        }
    }

    /// How many of these nodes are present.
    pub fn among<'a>(&self, nodes: impl Iterator<Item = &'a NodeId>) -> usize {
        let (seen, now) = (self.nodes(), self.clock.steady());
        let present = |node: &&NodeId| {
            seen.get(node).is_some_and(|seen| {
                seen.following > 0 || now.saturating_sub(seen.last) < AFTERWARDS
            })
        };
        nodes.filter(present).count()
    }

    /// A panic elsewhere leaves the map whole.
    fn nodes(&self) -> MutexGuard<'_, HashMap<NodeId, LastSeen>> {
        self.nodes.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Following {
    fn drop(&mut self) {
        let now = self.all.clock.steady();
        if let Some(seen) = self.all.nodes().get_mut(&self.node) {
            seen.following = seen.following.saturating_sub(1);
            seen.last = now;
        }
    }
}
