//! Updates that nodes have uploaded and not yet committed to. They lie on disk, in a folder for each round and node, within a quota.
//!
//! A node can commit only to what it has uploaded itself. When a round ends, what no node committed to is removed.

use std::path::{Path, PathBuf};
use std::{fs, io};
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::blobs::{BlobError, BlobWriter, Blobs};

/// How many uploads of a node may wait in one round: the first one, and some for a node that changes its mind.
pub const MAX_UPLOADS: usize = 4;

/// The uploads of all nodes.
#[derive(Clone, Debug)]
pub struct Staging {
    dir: PathBuf,
}

/// Why an upload cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum StagingError {
    /// The node has used up its quota.
    #[error(
        "node {0} has already uploaded {MAX_UPLOADS} updates in this round: commit to one of them"
    )]
    Quota(NodeId),
    /// The blob cannot be written.
    #[error(transparent)]
    Blob(#[from] BlobError),
    /// The file system failed.
    #[error("{path}: {error}")]
    Io { path: PathBuf, error: io::Error },
}

impl Staging {
    /// The uploads beside the ledger in `dir`.
    pub fn at(dir: &Path) -> Self {
        Self {
            dir: dir.join("uploads"),
        }
    }

    /// What `node` has uploaded in `round`.
    pub fn of(&self, round: u64, node: &NodeId) -> Blobs {
        Blobs::at(&self.dir.join(round.to_string()).join(node.to_string()))
    }

    /// Begins an upload of at most `size` bytes.
    pub fn begin(&self, round: u64, node: &NodeId, size: u64) -> Result<BlobWriter, StagingError> {
        let blobs = self.of(round, node);
        let somewhere = blobs.path(&Digest::default());
        let waiting = somewhere
            .parent()
            .and_then(|folder| fs::read_dir(folder).ok())
            .map_or(0, Iterator::count);
        match waiting {
            MAX_UPLOADS.. => Err(StagingError::Quota(*node)),
            _ => Ok(blobs.writer(size)?),
        }
    }

    /// Removes all uploads.
    pub fn clear(&self) -> Result<(), StagingError> {
        match fs::remove_dir_all(&self.dir) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(StagingError::Io {
                path: self.dir.clone(),
                error,
            }),
            _ => Ok(()),
        }
    }
}
