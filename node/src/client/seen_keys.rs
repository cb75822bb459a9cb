//! The newest key of the log that a node has seen. A thief who has the former one signs nothing for it.

use crate::client_error::NodeError;
use std::sync::atomic::{AtomicU64, Ordering};
use zk0_circuits::Digest;
use zk0_protocol::tlog::checkpoint::KeyedCheckpoint;

/// The network, and the entry that gave its log the newest key.
#[derive(Debug)]
pub(super) struct SeenKeys {
    network: Digest,
    since: AtomicU64,
}

impl SeenKeys {
    /// Of the log of this network.
    pub fn of(network: Digest) -> Self {
        Self {
            network,
            since: AtomicU64::new(0),
        }
    }

    /// Takes a checkpoint that the log has signed, unless it came after the log had another key.
    pub fn take(&self, signed: &KeyedCheckpoint) -> Result<(), NodeError> {
        signed.check_network(&self.network)?;
        let since = self.since.fetch_max(signed.since, Ordering::Relaxed);
        let size = signed.checkpoint.size;
        if signed.since < since && size > since {
            Err(NodeError::FormerKey { size, since })
        } else {
            Ok(())
        }
    }

    /// Takes the log's newest checkpoint, unless the log had another key before. An older one proves nothing of today.
    pub fn take_newest(&self, signed: &KeyedCheckpoint) -> Result<(), NodeError> {
        self.take(signed)?;
        let newest = self.since.load(Ordering::Relaxed);
        if signed.since < newest {
            Err(NodeError::FormerKey {
                size: signed.checkpoint.size,
                since: newest,
            })
        } else {
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zk0_protocol::Checkpoint;

    #[test]
    fn a_former_key_signs_nothing_later() {
        let keys = SeenKeys::of(Digest([1; 32]));
        let signed = |size, since| KeyedCheckpoint {
            checkpoint: Checkpoint {
                size,
                root: Digest([0; 32]),
            },
            key: [0; 32],
            since,
            network: None,
        };
        keys.take(&signed(20, 0)).unwrap();
        keys.take(&signed(12, 10)).unwrap();
        // A receipt from before the change.
        keys.take(&signed(10, 0)).unwrap();
        keys.take_newest(&signed(10, 0)).unwrap_err();
        keys.take_newest(&signed(12, 10)).unwrap();
        let refused = keys.take(&signed(11, 0)).unwrap_err();
        assert!(matches!(
            refused,
            NodeError::FormerKey {
                size: 11,
                since: 10
            }
        ));
    }
}
