//! Updates that were uploaded but not committed yet: on disk, apart by round and node, within a quota.
//!
//! A node can only commit what it has uploaded itself. What was not committed when a round ends is thrown away.

use std::{
    fs, io,
    path::{Path, PathBuf},
};
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::blobs::{BlobError, BlobWriter, Blobs};

/// Uploads a node may have waiting in one round: the first one, and some to think again.
pub const MAX_UPLOADS: usize = 4;

/// The uploads of all nodes.
#[derive(Clone, Debug)]
pub struct Staging {
    dir: PathBuf,
}

/// Why an upload cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum StagingError {
    /// Over the quota.
    #[error(
        "node {0} has already uploaded {MAX_UPLOADS} updates in this round: commit to one of them"
    )]
    Quota(NodeId),
    /// The disk.
    #[error(transparent)]
    Blob(#[from] BlobError),
    /// The disk.
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

    /// Throws everything away.
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
