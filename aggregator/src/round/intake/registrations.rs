//! How often a node registers a dataset: normally when its recording has grown, or the rules ask for other frames.
//!
//! A registration stays on the ledger for ever, and every replay holds its episodes, up to 1,500, in memory. Between rounds the rules set
//! no limit, so the aggregator does.

use borsh::{BorshDeserialize, BorshSerialize};
use std::collections::{BTreeMap, VecDeque};
use zk0_circuits::NodeId;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::signed::KeyRotation;

/// Datasets that a node may register before a round has closed, or [`PERIOD_MS`] has passed.
pub const MAX_REGISTRATIONS: usize = 4;

/// A day, in milliseconds. A network may have no rounds for long.
pub const PERIOD_MS: u64 = 86_400_000;

/// Each node's last registrations since a round has closed, by entry: at most [`MAX_REGISTRATIONS`].
#[derive(Clone, Debug, Default, BorshSerialize, BorshDeserialize)]
pub struct Registrations(BTreeMap<NodeId, VecDeque<u64>>);

impl Registrations {
    /// Notes entry `index`.
    pub fn observe(&mut self, index: u64, body: &Body) {
        match body {
            Body::DatasetCommitted(signed) => {
                let last = self.0.entry(signed.statement.node).or_default();
                last.push_back(index);
                if last.len() > MAX_REGISTRATIONS {
                    last.pop_front();
                }
            }
            Body::RoundClosed(_) => self.0.clear(),
            // It is the same node.
            Body::KeyRotated { rotation, .. } => {
                let KeyRotation { node, with, .. } = rotation.statement;
                if let Some(last) = self.0.remove(&node) {
                    self.0.insert(with, last);
                }
            }
            _ => {}
        }
    }

    /// The first of a node's last [`MAX_REGISTRATIONS`] entries, if there are so many. [`PERIOD_MS`] later, it may register again.
    pub fn first(&self, node: &NodeId) -> Option<u64> {
        let last = self.0.get(node)?;
        last.front()
            .filter(|_| last.len() == MAX_REGISTRATIONS)
            .copied()
    }
}
