//! The nonces of the heads that have come, so that each head counts once.
//!
//! A nonce is forgotten when a head of its time is too old to count. A clock that is set forward makes all nonces old at once, and when it
//! is set back, the same heads would count again. So the window remembers the latest time of which it has forgotten a nonce, and takes no
//! head of that time or before.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::sync::{Mutex, PoisonError};
use zk0_circuits::NodeId;
use zk0_protocol::request_head::{HeadRefusal, RequestHead};

/// The most nonces that are remembered of one sender. A node needs about ten in a round.
pub const PER_SENDER: usize = 1024;

/// The most nonces that are remembered in all, so that 256 members together can use up the room for all.
pub const IN_ALL: usize = 256 * PER_SENDER;

/// The nonces of members. Nobody else's are remembered, so strangers cannot fill the window.
pub struct ReplayWindow {
    skew_ms: u64,
    per_sender: usize,
    in_all: usize,
    seen: Mutex<SeenRequest>,
}

#[derive(Default)]
struct SeenRequest {
    by_time: BTreeSet<(u64, NodeId, [u8; 16])>,
    by_sender: HashMap<NodeId, HashSet<[u8; 16]>>,
    /// The latest time of which a nonce is forgotten.
    forgotten_ms: Option<u64>,
}

impl ReplayWindow {
    /// An empty window for clocks that may differ by `skew_ms`.
    pub fn new(skew_ms: u64) -> Self {
        Self::of(skew_ms, PER_SENDER, IN_ALL)
    }

    fn of(skew_ms: u64, per_sender: usize, in_all: usize) -> Self {
        Self {
            skew_ms,
            per_sender,
            in_all,
            seen: Mutex::default(),
        }
    }

    /// How much the clocks of sender and aggregator may differ, in milliseconds.
    pub fn skew_ms(&self) -> u64 {
        self.skew_ms
    }

    /// Takes a head of a member at `now_ms`, if its nonce is new. The head was compared with its request, and its signature is valid.
    pub fn take(&self, head: &RequestHead, now_ms: u64) -> Result<(), HeadRefusal> {
        // A panic elsewhere does not spoil the sets: nothing in between can panic.
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        seen.forget_before(now_ms.saturating_sub(self.skew_ms));
        if seen.forgotten_ms.is_some_and(|time| head.time_ms <= time) {
            return Err(HeadRefusal::Forgotten {
                sender_ms: head.time_ms,
            });
        }
        let of_sender = seen.by_sender.get(&head.sender);
        if of_sender.is_some_and(|nonces| nonces.contains(&head.nonce)) {
            return Err(HeadRefusal::Replayed);
        }
        if of_sender.is_some_and(|nonces| nonces.len() >= self.per_sender) {
            return Err(HeadRefusal::TooMany {
                sender: head.sender,
                limit: self.per_sender,
            });
        }
        if seen.by_time.len() >= self.in_all {
            return Err(HeadRefusal::NoRoom { limit: self.in_all });
        }
        seen.by_time.insert((head.time_ms, head.sender, head.nonce));
        let nonces = seen.by_sender.entry(head.sender).or_default();
        nonces.insert(head.nonce);
        Ok(())
    }
}

impl SeenRequest {
    /// Forgets the nonces of heads that were signed before `oldest_ms`.
    fn forget_before(&mut self, oldest_ms: u64) {
        while let Some((time_ms, sender, nonce)) = self.by_time.first().copied() {
            if time_ms >= oldest_ms {
                return;
            }
            self.by_time.pop_first();
            self.forgotten_ms = self.forgotten_ms.max(Some(time_ms));
            if let Some(nonces) = self.by_sender.get_mut(&sender) {
                nonces.remove(&nonce);
                if nonces.is_empty() {
                    self.by_sender.remove(&sender);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zk0_circuits::Digest;
    use zk0_protocol::request_head::Method;

    fn head(sender: u8, time_ms: u64, nonce: u8) -> RequestHead {
        RequestHead {
            network: Digest([0; 32]),
            run: [0; 16],
            method: Method::Record,
            round: None,
            body: Digest([0; 32]),
            sender: NodeId([sender; 32]),
            time_ms,
            nonce: [nonce; 16],
        }
    }

    #[test]
    fn a_nonce_counts_once_for_its_sender_at_whatever_time() {
        let window = ReplayWindow::new(1000);
        window.take(&head(1, 5000, 1), 5000).unwrap();
        window.take(&head(2, 5000, 1), 5000).unwrap();
        for time_ms in [5000, 5001] {
            let again = window.take(&head(1, time_ms, 1), 5500);
            assert_eq!(again, Err(HeadRefusal::Replayed));
        }
    }

    #[test]
    fn a_clock_that_is_set_forward_and_back_lets_no_head_count_again() {
        let window = ReplayWindow::new(1000);
        window.take(&head(1, 5000, 1), 5000).unwrap();
        window.take(&head(1, 90_000, 2), 90_000).unwrap();
        let again = window.take(&head(1, 5000, 1), 5500);
        assert_eq!(again, Err(HeadRefusal::Forgotten { sender_ms: 5000 }));
        // What is new counts.
        window.take(&head(1, 5001, 3), 5500).unwrap();
    }

    #[test]
    fn what_is_remembered_is_bounded_and_forgotten_in_time() {
        let window = ReplayWindow::of(1000, 2, 3);
        for nonce in [1, 2] {
            window.take(&head(1, 5000, nonce), 5000).unwrap();
        }
        let third = window.take(&head(1, 5000, 3), 5000);
        assert!(
            matches!(third, Err(HeadRefusal::TooMany { limit: 2, .. })),
            "{third:?}"
        );
        window.take(&head(2, 5000, 1), 5000).unwrap();
        let fourth = window.take(&head(3, 5000, 1), 5000);
        assert_eq!(fourth, Err(HeadRefusal::NoRoom { limit: 3 }));
        window.take(&head(1, 6500, 3), 6500).unwrap();
        let seen = window.seen.lock().unwrap();
        assert_eq!((seen.by_time.len(), seen.by_sender.len()), (1, 1));
    }
}
