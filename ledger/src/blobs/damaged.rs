//! Blobs that are damaged where they are kept. A copy of many blobs names them, and goes on.

use super::error::BlobError;
use super::Blobs;
use std::fmt;
use std::io::{self, Read};
use zk0_circuits::Digest;

/// A blob that is damaged where it is kept, and so is not copied.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DamagedBlob {
    /// The blob.
    pub blob: Digest,
    /// Where it is kept: its file's path, or its name in the blob store.
    pub place: String,
    /// What is wrong with it.
    pub why: String,
    /// What to do.
    advice: &'static str,
}

impl fmt::Display for DamagedBlob {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} is damaged: {}. {}",
            self.place, self.why, self.advice
        )
    }
}

/// What became of a folder's damaged blobs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Removed {
    /// Removed blobs, which had other bytes.
    pub removed: Vec<Digest>,
    /// Unreadable blobs.
    pub unreadable: Vec<DamagedBlob>,
}

#[derive(Debug)]
pub(crate) enum CopyError {
    /// Its bytes cannot be read.
    Unreadable(io::Error),
    /// Its digest is wrong, or it cannot be written.
    Blob(BlobError),
}

impl From<BlobError> for CopyError {
    fn from(error: BlobError) -> Self {
        Self::Blob(error)
    }
}

impl Blobs {
    /// Stores a blob of at most `limit` bytes from `from`, if it has this digest, in place of what is there.
    pub(crate) fn copy_from(
        &self,
        blob: &Digest,
        from: &mut dyn Read,
        limit: u64,
    ) -> Result<(), CopyError> {
        let mut writer = self.writer(limit)?;
        let mut buffer = vec![0; 64 << 10];
        loop {
            match from.read(&mut buffer) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(CopyError::Unreadable(error)),
                Ok(0) => return Ok(writer.finish(blob)?),
                Ok(read) => writer.write(&buffer[..read])?,
            }
        }
    }

    /// Removes a blob's file from the folder if its bytes do not have the digest, so that an update of the mirror copies it again. Returns
    /// whether it did.
    pub fn remove_damaged(&self, blob: &Digest) -> Result<bool, BlobError> {
        match self.check(blob) {
            Err(BlobError::WrongDigest { .. }) => {
                self.remove_here(blob)?;
                Ok(true)
            }
            Ok(()) | Err(BlobError::Missing(_)) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// Reads all blobs in the folder, and removes the damaged files. Unreadable files stay.
    pub fn remove_all_damaged(&self) -> Result<Removed, BlobError> {
        let mut done = Removed::default();
        for (blob, _) in self.all_here()? {
            match self.remove_damaged(&blob) {
                Ok(true) => done.removed.push(blob),
                Ok(false) => {}
                Err(error) => done.unreadable.push(self.damage(&blob, error)?),
            }
        }
        Ok(done)
    }

    /// What `error`, from reading or copying one of these blobs, means for it.
    ///
    /// # Errors
    /// The error itself, if it is not about the blob: the store does not answer, or the copy cannot be written.
    pub(crate) fn damage(&self, blob: &Digest, error: BlobError) -> Result<DamagedBlob, BlobError> {
        match error {
            BlobError::WrongDigest { actual, .. } => {
                Ok(self.damaged_here(blob, format!("its bytes have SHA-256 {actual}")))
            }
            BlobError::Io { path, error } if path == self.path(blob) => {
                Ok(self.damaged_here(blob, error.to_string()))
            }
            BlobError::Altered { address, found, .. } => Ok(DamagedBlob {
                blob: *blob,
                place: format!("blob {blob} in the blob store {address}"),
                why: format!("the store has {found} under its name"),
                advice: "Put the right file back there",
            }),
            other => Err(other),
        }
    }

    pub(crate) fn damaged_here(&self, blob: &Digest, why: String) -> DamagedBlob {
        DamagedBlob {
            blob: *blob,
            place: self.path(blob).display().to_string(),
            why,
            advice: match self.store_address() {
                None => "Put the right file back, from a backup, a mirror or a node that has it",
                Some(_) => "Delete this file: the blob is then read from the blob store",
            },
        }
    }
}
