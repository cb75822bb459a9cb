//! The last committed updates, so that no node contributes another node's.
//!
//! A limit bounds the memory for following a log. It counts updates, not rounds or days: an aggregator could let many empty
//! rounds pass at once, but each node commits once a round.

use borsh::{BorshDeserialize, BorshSerialize};
use std::collections::{BTreeMap, VecDeque};
use zk0_circuits::{Digest, NodeId, WeightsDigest};

/// How many updates are remembered. A copy of an older one must still improve on the present network.
pub const REMEMBERED_UPDATES: usize = 1 << 16;

/// The last [`REMEMBERED_UPDATES`] updates, each with its node.
#[derive(Clone, Debug, Default, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Updates {
    /// By the digests of bytes and of numbers: the same numbers in other bytes are the same update.
    by_digest: BTreeMap<Digest, CommittedUpdate>,
    in_order: VecDeque<(u64, WeightsDigest)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
struct CommittedUpdate {
    node: NodeId,
    /// The last entry that commits to it.
    entry: u64,
}

impl Updates {
    pub(crate) fn committer(&self, digest: &Digest) -> Option<&NodeId> {
        self.by_digest.get(digest).map(|committed| &committed.node)
    }

    /// Remembers the update of entry `entry`, and forgets the oldest beyond the limit.
    pub(crate) fn remember(&mut self, update: &WeightsDigest, node: NodeId, entry: u64) {
        for digest in [update.blob, update.quantised] {
            self.by_digest
                .insert(digest, CommittedUpdate { node, entry });
        }
        self.in_order.push_back((entry, *update));
        if self.in_order.len() > REMEMBERED_UPDATES {
            if let Some((entry, update)) = self.in_order.pop_front() {
                self.forget(entry, &update);
            }
        }
    }

    /// Forgets an update, unless a later entry commits to it.
    fn forget(&mut self, entry: u64, update: &WeightsDigest) {
        for digest in [update.blob, update.quantised] {
            let known = self.by_digest.get(&digest);
            if known.is_some_and(|committed| committed.entry == entry) {
                self.by_digest.remove(&digest);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn update(number: u64) -> WeightsDigest {
        let digest = |part: u8| {
            let mut bytes = [part; 32];
            bytes[..8].copy_from_slice(&number.to_le_bytes());
            Digest(bytes)
        };
        WeightsDigest {
            blob: digest(1),
            quantised: digest(2),
        }
    }

    #[test]
    fn so_many_are_remembered_and_no_more() {
        let (node, limit) = (NodeId([7; 32]), REMEMBERED_UPDATES as u64);
        let mut updates = Updates::default();
        (0..limit).for_each(|number| updates.remember(&update(number), node, number));
        // A second commitment makes this update recent again.
        updates.remember(&update(1), node, limit);
        let known = |updates: &Updates, number| {
            let WeightsDigest { blob, quantised } = update(number);
            let [one, other] = [blob, quantised].map(|digest| updates.committer(&digest).copied());
            assert_eq!(one, other);
            one
        };
        assert_eq!(known(&updates, 0), None);
        updates.remember(&update(limit), node, limit + 1);
        assert_eq!(known(&updates, 1), Some(node));
        assert_eq!(known(&updates, 2), Some(node));
        assert_eq!(known(&updates, limit), Some(node));
        assert_eq!(updates.in_order.len(), REMEMBERED_UPDATES);
        assert_eq!(updates.by_digest.len(), 2 * REMEMBERED_UPDATES);
    }
}
