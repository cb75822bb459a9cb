//! Uploaded updates without a commitment, on disk, in a folder for each round and node, within a quota.
//!
//! A node can commit only to its own upload. A cut upload stays, so that the node goes on after it. The end of the round removes what is
//! not committed.

use std::path::{Path, PathBuf};
use std::{fs, io};
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::blobs::partial::PartialBlob;
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_protocol::entries::signed::UploadRequest;

/// Waiting uploads of a node in one round: one, and some for a node that changes its mind.
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
        "node {0} has already uploaded {MAX_UPLOADS} updates in this round, or parts of them: commit to one of them"
    )]
    Quota(NodeId),
    /// The data would leave a gap, or begin with bytes that are here.
    #[error(
        "the data of this upload begins at byte {begins}, and {held} bytes of the update are here: ask how many there are, and go on after them"
    )]
    OtherPlace { begins: u64, held: u64 },
    /// The blob cannot be written.
    #[error(transparent)]
    Blob(#[from] BlobError),
    /// The file system failed.
    #[error("{path}: {error}")]
    Io { path: PathBuf, error: io::Error },
}

/// Whether the quota has room for this upload. One that has begun counts already, even if cut before its first byte.
fn has_room(blobs: &Blobs, update: &Digest) -> Result<bool, StagingError> {
    Ok(blobs.has_begun(update)? || blobs.count() < MAX_UPLOADS)
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

    /// How many bytes of an update are here.
    pub fn held(&self, request: &UploadRequest) -> Result<u64, StagingError> {
        let blobs = self.of(request.round, &request.node);
        Ok(blobs.held(&request.blob)?)
    }

    /// Whether the whole update may be uploaded: none of it is here, and the quota has room.
    pub fn begins(&self, request: &UploadRequest) -> Result<bool, StagingError> {
        let blobs = self.of(request.round, &request.node);
        Ok(blobs.held(&request.blob)? == 0 && has_room(&blobs, &request.blob)?)
    }

    /// Goes on with an upload at byte `begins`, after reading what is here. `None` if all of it is here.
    pub fn go_on(
        &self,
        request: &UploadRequest,
        begins: u64,
    ) -> Result<Option<PartialBlob>, StagingError> {
        let blobs = self.of(request.round, &request.node);
        if blobs.contains(&request.blob) {
            return Ok(None);
        }
        if !has_room(&blobs, &request.blob)? {
            return Err(StagingError::Quota(request.node));
        }
        let held = blobs.held(&request.blob)?;
        if begins != held {
            return Err(StagingError::OtherPlace { begins, held });
        }
        Ok(Some(blobs.partial(&request.blob, request.size)?))
    }

    /// Removes the uploads of the rounds up to `last`, perhaps for seconds. An upload in progress may leave something for the next call.
    pub fn clear(&self, last: u64) -> Result<(), StagingError> {
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |error| StagingError::Io { path, error }
        };
        let all = match fs::read_dir(&self.dir) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            all => all.map_err(failed(&self.dir))?,
        };
        for one in all {
            let path = one.map_err(failed(&self.dir))?.path();
            let round = path
                .file_name()
                .and_then(|name| name.to_str()?.parse().ok());
            if round.is_none_or(|round: u64| round <= last) {
                fs::remove_dir_all(&path).map_err(failed(&path))?;
            }
        }
        Ok(())
    }
}
