//! Where an export is written: anything that keeps files by path, such as a folder or a bucket.

use crate::blobs::damaged::CopyError;
use crate::blobs::{BlobError, Blobs};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use zk0_circuits::Digest;
use zk0_files::{atomic_file, bounded_file};
use zk0_protocol::tlog::layout::{Resource, Tile};

/// Keeps an export's files durably, by the paths of [`zk0_protocol::tlog::layout`].
pub trait ExportTarget {
    /// Its name in messages: a path, or an address without credentials.
    fn name(&self) -> String;

    /// The first `limit` bytes of its checkpoint; `None` if there is none.
    fn checkpoint(&self, limit: u64) -> Result<Option<Vec<u8>>, PlaceError>;

    /// Whether the whole tile is known to be there.
    fn holds_tile(&self, tile: &Tile) -> bool;

    /// The size in bytes of a blob that is there.
    fn blob_size(&self, blob: &Digest) -> Option<u64>;

    /// Writes or replaces a file. Returns false if a whole file stayed.
    fn put(&mut self, resource: &Resource, bytes: &[u8]) -> Result<bool, PlaceError>;

    /// Writes a blob, unless `file`'s bytes have another digest ([`BlobError::WrongDigest`]) or cannot be read
    /// ([`PlaceError::Unreadable`]).
    fn put_blob(&mut self, blob: &Digest, file: File) -> Result<(), PlaceError>;
}

/// An export cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum PlaceError {
    /// A blob is unreadable, not writable, or has the wrong digest.
    #[error(transparent)]
    Blob(#[from] BlobError),
    /// The ledger's blob cannot be read.
    #[error("the blob cannot be read: {0}")]
    Unreadable(io::Error),
    /// The place failed.
    #[error("{name}: {why}")]
    Failed {
        /// The file's name in messages.
        name: String,
        /// Why it failed.
        why: String,
    },
}

/// A folder.
pub struct ExportFolder {
    dir: PathBuf,
    blobs: Blobs,
}

impl ExportFolder {
    /// The export in `dir`. Reads and writes nothing.
    pub fn at(dir: &Path) -> Self {
        Self {
            dir: dir.into(),
            blobs: Blobs::at(dir),
        }
    }

    /// Removes what killed exports left.
    pub(crate) fn remove_unfinished(&self) -> Result<(), PlaceError> {
        Ok(self.blobs.remove_unfinished()?)
    }

    fn path(&self, resource: &Resource) -> PathBuf {
        self.dir.join(resource.to_string())
    }
}

fn failed(path: &Path) -> impl FnOnce(io::Error) -> PlaceError + '_ {
    |error| PlaceError::Failed {
        name: path.display().to_string(),
        why: error.to_string(),
    }
}

impl ExportTarget for ExportFolder {
    fn name(&self) -> String {
        self.dir.display().to_string()
    }

    fn checkpoint(&self, limit: u64) -> Result<Option<Vec<u8>>, PlaceError> {
        let path = self.path(&Resource::Checkpoint);
        bounded_file::start_if_there(&path, limit).map_err(failed(&path))
    }

    fn holds_tile(&self, tile: &Tile) -> bool {
        self.path(&Resource::Tile(*tile)).exists()
    }

    fn blob_size(&self, blob: &Digest) -> Option<u64> {
        self.blobs.size(blob)
    }

    fn put(&mut self, resource: &Resource, bytes: &[u8]) -> Result<bool, PlaceError> {
        let path = self.path(resource);
        fs::create_dir_all(atomic_file::folder_of(&path))
            .and_then(|()| atomic_file::replace(&path, bytes))
            .map(|()| true)
            .map_err(failed(&path))
    }

    fn put_blob(&mut self, blob: &Digest, mut file: File) -> Result<(), PlaceError> {
        let copied = self.blobs.copy_from(blob, &mut file, u64::MAX);
        copied.map_err(|error| match error {
            CopyError::Unreadable(error) => PlaceError::Unreadable(error),
            CopyError::Blob(error) => PlaceError::Blob(error),
        })
    }
}
