//! The signed heads of requests: each shows who sends its request, and counts once.
//!
//! A client that has lost an answer signs another head and repeats its statement, for the same receipt.
//!
//! Heads are not on disk. A started aggregator makes a new run, and takes no heads of others. So a restart revives no old head, whatever
//! the clocks show, and needs no wait.
//!
//! A head too old to count is forgotten. A clock set forward and back would revive it. So the window remembers the latest time of which it
//! has forgotten a head, and takes none of that time or before.

use std::collections::{BTreeSet, HashMap};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::request_head::{Arrived, HeadRefusal, RequestHead};

/// The most heads remembered of one sender. A node needs about ten in a round.
pub const PER_SENDER: usize = 1024;

/// Heads of members alone, so that strangers cannot fill the window.
pub struct ReplayWindow {
    network: Digest,
    /// The run that heads have to name.
    pub run: [u8; 16],
    skew_ms: u64,
    per_sender: usize,
    senders: Mutex<HashMap<NodeId, SeenHeads>>,
}

/// The heads of one sender, by their times and nonces.
#[derive(Default)]
struct SeenHeads {
    heads: BTreeSet<(u64, [u8; 16])>,
    forgotten_ms: Option<u64>,
}

impl ReplayWindow {
    /// An empty window for heads of this network. Clocks of senders may differ from the aggregator's by `skew`.
    ///
    /// # Panics
    /// The system gives no random bytes.
    pub fn new(network: Digest, skew: Duration) -> Self {
        let mut run = [0; 16];
        getrandom::fill(&mut run).expect("the system gives random bytes");
        Self {
            network,
            run,
            skew_ms: u64::try_from(skew.as_millis()).unwrap_or(u64::MAX),
            per_sender: PER_SENDER,
            senders: Mutex::default(),
        }
    }

    /// What a head of `now_ms` has to agree with.
    pub fn arrived(&self, now_ms: u64) -> Arrived {
        Arrived {
            network: self.network,
            run: self.run,
            now_ms,
            skew_ms: self.skew_ms,
        }
    }

    /// Takes a head of a member, with a valid signature, at `now_ms`, if it is new.
    pub fn take(&self, head: &RequestHead, now_ms: u64) -> Result<(), HeadRefusal> {
        // A panic elsewhere leaves the sets whole.
        let mut senders = self.senders.lock().unwrap_or_else(PoisonError::into_inner);
        let seen = senders.entry(head.sender).or_default();
        let oldest_ms = now_ms.saturating_sub(self.skew_ms);
        let kept = seen.heads.split_off(&(oldest_ms, [0; 16]));
        let forgotten = std::mem::replace(&mut seen.heads, kept);
        let latest_ms = forgotten.last().map(|(time_ms, _)| *time_ms);
        seen.forgotten_ms = seen.forgotten_ms.max(latest_ms);
        if seen.forgotten_ms.is_some_and(|time| head.time_ms <= time) {
            return Err(HeadRefusal::Forgotten {
                sender_ms: head.time_ms,
            });
        }
        let this = (head.time_ms, head.nonce);
        if seen.heads.contains(&this) {
            return Err(HeadRefusal::Replayed);
        }
        if seen.heads.len() >= self.per_sender {
            return Err(HeadRefusal::TooMany {
                sender: head.sender,
                limit: self.per_sender,
            });
        }
        seen.heads.insert(this);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zk0_protocol::request_head::Method;

    fn window() -> ReplayWindow {
        ReplayWindow::new(Digest([0; 32]), Duration::from_secs(1))
    }

    fn head(sender: u8, time_ms: u64, nonce: u8) -> RequestHead {
        RequestHead {
            network: Digest([0; 32]),
            run: [0; 16],
            method: Method::Submit,
            round: None,
            body: Digest([0; 32]),
            sender: NodeId([sender; 32]),
            time_ms,
            nonce: [nonce; 16],
        }
    }

    #[test]
    fn a_head_counts_once_for_its_sender() {
        let window = window();
        window.take(&head(1, 5000, 1), 5000).unwrap();
        window.take(&head(2, 5000, 1), 5000).unwrap();
        let again = window.take(&head(1, 5000, 1), 5500);
        assert_eq!(again, Err(HeadRefusal::Replayed));
    }

    #[test]
    fn a_clock_that_is_set_forward_and_back_lets_no_head_count_again() {
        let window = window();
        window.take(&head(1, 5000, 1), 5000).unwrap();
        window.take(&head(1, 90_000, 2), 90_000).unwrap();
        let again = window.take(&head(1, 5000, 1), 5500);
        assert_eq!(again, Err(HeadRefusal::Forgotten { sender_ms: 5000 }));
        // A new one counts.
        window.take(&head(1, 5001, 3), 5500).unwrap();
    }

    #[test]
    fn what_is_remembered_is_bounded_and_forgotten_in_time() {
        let mut window = window();
        window.per_sender = 2;
        for nonce in [1, 2] {
            window.take(&head(1, 5000, nonce), 5000).unwrap();
        }
        let third = window.take(&head(1, 5000, 3), 5000);
        assert!(
            matches!(third, Err(HeadRefusal::TooMany { limit: 2, .. })),
            "{third:?}"
        );
        window.take(&head(2, 5000, 3), 5000).unwrap();
        window.take(&head(1, 6500, 3), 6500).unwrap();
        assert_eq!(
            window.senders.lock().unwrap()[&NodeId([1; 32])].heads.len(),
            1
        );
    }
}
