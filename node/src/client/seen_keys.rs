//! The newest key of the log that a node has seen. A thief who has a former one signs nothing for it, whatever size the thief's tree has: only
//! a published tree with the present key's signature shows which entries the log had before.
//!
//! A node keeps it in its folder, and so also knows it at its next start.

use crate::client_error::NodeError;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use zk0_circuits::Digest;
use zk0_files::{atomic_file, bounded_file};
use zk0_protocol::tlog::checkpoint::KeyedCheckpoint;

/// The file in a node's folder. It has the network's id, and the number of the entry that gave its log the newest key.
const FILE: &str = "log-key";

/// Longer files are something else.
const MAX_BYTES: u64 = 100;

/// The network, and the entry that gave its log the newest key.
#[derive(Debug)]
pub(super) struct SeenKeys {
    network: Digest,
    since: AtomicU64,
    /// Where it is kept.
    file: Option<PathBuf>,
}

impl SeenKeys {
    /// Of the log of this network.
    pub fn of(network: Digest) -> Self {
        Self {
            network,
            since: AtomicU64::new(0),
            file: None,
        }
    }

    /// What a node of this network has kept in its folder `state`, and keeps there.
    pub fn kept_in(state: &Path, network: Digest) -> Result<Self, NodeError> {
        let path = state.join(FILE);
        let kept = bounded_file::read_if_there(&path, MAX_BYTES)
            .map_err(|error| broken(&path, error.to_string()))?;
        let since = match kept {
            None => 0,
            Some(kept) => match read(&kept) {
                None => return Err(broken(&path, "it names no network and no entry".into())),
                Some((of, since)) if of == network => since,
                Some(_) => 0,
            },
        };
        Ok(Self {
            network,
            since: AtomicU64::new(since),
            file: Some(path),
        })
    }

    /// The network.
    pub fn network(&self) -> Digest {
        self.network
    }

    /// Takes a published checkpoint that the log has signed with its newest key.
    pub fn take(&self, signed: &KeyedCheckpoint) -> Result<(), NodeError> {
        self.check(signed)?;
        let since = signed.since;
        if since > self.since.load(Ordering::Relaxed) {
            if let Some(path) = self.file.as_ref() {
                let kept = format!("{} {since}\n", self.network);
                atomic_file::replace(path, kept.as_bytes())
                    .map_err(|error| broken(path, error.to_string()))?;
            }
            self.since.fetch_max(since, Ordering::Relaxed);
        }
        Ok(())
    }

    /// Takes the checkpoint of an entry that needs the one of its own size: it may be older than the newest key. Alone it proves nothing. A
    /// later entry has to confirm it.
    pub fn take_of_size(&self, signed: &KeyedCheckpoint) -> Result<(), NodeError> {
        let newest = self.since.load(Ordering::Relaxed);
        if signed.since < newest && signed.checkpoint.size <= newest {
            Ok(signed.check_network(&self.network)?)
        } else {
            self.take(signed)
        }
    }

    /// Checks the key, and learns none from a checkpoint that is perhaps not published yet: what is published may still have a former one's
    /// signature.
    pub fn check(&self, signed: &KeyedCheckpoint) -> Result<(), NodeError> {
        signed.check_network(&self.network)?;
        let newest = self.since.load(Ordering::Relaxed);
        if signed.since < newest {
            return Err(NodeError::FormerKey {
                size: signed.checkpoint.size,
                since: newest,
            });
        }
        Ok(())
    }
}

fn read(kept: &[u8]) -> Option<(Digest, u64)> {
    let text = std::str::from_utf8(kept).ok()?;
    let (network, since) = text.trim_end().split_once(' ')?;
    Some((network.parse().ok()?, since.parse().ok()?))
}

fn broken(path: &Path, why: String) -> NodeError {
    NodeError::SeenKey {
        path: path.into(),
        why,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use zk0_protocol::Checkpoint;

    fn signed(size: u64, since: u64) -> KeyedCheckpoint {
        KeyedCheckpoint {
            checkpoint: Checkpoint {
                size,
                root: Digest([0; 32]),
            },
            key: [0; 32],
            since,
            network: None,
        }
    }

    #[test]
    fn a_former_key_signs_nothing_for_a_node() {
        let keys = SeenKeys::of(Digest([1; 32]));
        keys.take(&signed(20, 0)).unwrap();
        // Perhaps what is published has the former key's signature for some time.
        keys.check(&signed(12, 10)).unwrap();
        keys.take(&signed(9, 0)).unwrap();
        keys.take(&signed(12, 10)).unwrap();
        for size in [9, 10, 11, 12] {
            let refused = keys.take(&signed(size, 0)).unwrap_err();
            let found =
                matches!(refused, NodeError::FormerKey { size: of, since: 10 } if of == size);
            assert!(found, "{refused}");
        }
        // The closing of a round from before the change.
        keys.take_of_size(&signed(10, 0)).unwrap();
        keys.take_of_size(&signed(11, 0)).unwrap_err();
    }

    #[test]
    fn a_node_knows_the_key_at_its_next_start() {
        let folder = tempfile::tempdir().unwrap();
        let network = Digest([1; 32]);
        let kept = |network| SeenKeys::kept_in(folder.path(), network);
        kept(network).unwrap().take(&signed(20, 0)).unwrap();
        assert!(!folder.path().join(FILE).exists());
        kept(network).unwrap().take(&signed(12, 10)).unwrap();
        kept(network).unwrap().take(&signed(12, 0)).unwrap_err();
        kept(network).unwrap().take(&signed(12, 10)).unwrap();
        kept(Digest([2; 32])).unwrap().take(&signed(12, 0)).unwrap();
        for wrong in ["", "10", "0101 ten", &"1".repeat(101)] {
            fs::write(folder.path().join(FILE), wrong).unwrap();
            let refused = kept(network).map(drop).unwrap_err();
            assert!(matches!(refused, NodeError::SeenKey { .. }), "{refused}");
        }
    }
}
