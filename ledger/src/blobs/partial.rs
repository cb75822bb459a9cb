//! Blobs from a network, of which a part may be here already.

use super::{check, io_error, BlobError, Blobs, UnfinishedBlob};
use sha2::{Digest as _, Sha256};
use std::fs::{self, File};
use std::io;
use std::path::PathBuf;
use zk0_circuits::Digest;
use zk0_files::atomic_file::folder_of;

/// A blob of which a part is here. The part outlives this, and can be continued, by one writer at a time.
#[derive(Debug)]
pub struct PartialBlob {
    unfinished: UnfinishedBlob,
    hasher: Sha256,
    digest: Digest,
    held: u64,
    size: u64,
}

impl Blobs {
    /// How many bytes of a blob are here.
    pub fn held(&self, digest: &Digest) -> Result<u64, BlobError> {
        for path in [self.path(digest), self.partial_path(digest)] {
            match fs::metadata(&path) {
                Ok(found) => return Ok(found.len()),
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(io_error(&path)(error)),
            }
        }
        Ok(0)
    }

    /// Whether a file of this blob is here: all of it, or a part, perhaps empty.
    pub fn has_begun(&self, digest: &Digest) -> Result<bool, BlobError> {
        for path in [self.path(digest), self.partial_path(digest)] {
            if fs::exists(&path).map_err(io_error(&path))? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Continues a blob of `size` bytes, after reading the part that is here.
    pub fn partial(&self, digest: &Digest, size: u64) -> Result<PartialBlob, BlobError> {
        let path = self.partial_path(digest);
        self.make_folders(folder_of(&path))?;
        let mut options = File::options();
        options.read(true).append(true).create(true);
        let mut file = options.open(&path).map_err(io_error(&path))?;
        let mut hasher = Sha256::new();
        let held = io::copy(&mut file, &mut hasher).map_err(io_error(&path))?;
        let unfinished = UnfinishedBlob {
            blobs: self.clone(),
            path,
            file,
            kept: true,
        };
        let mut partial = PartialBlob {
            unfinished,
            hasher,
            digest: *digest,
            held,
            size,
        };
        if held > size {
            Err(partial.refuse(held))
        } else {
            Ok(partial)
        }
    }

    fn partial_path(&self, digest: &Digest) -> PathBuf {
        self.dir.join("partial").join(digest.to_string())
    }
}

impl PartialBlob {
    /// How many bytes are here.
    pub fn held(&self) -> u64 {
        self.held
    }

    /// Adds bytes. If the blob then has too many, all are removed.
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), BlobError> {
        let held = self.held.saturating_add(bytes.len() as u64);
        if held > self.size {
            return Err(self.refuse(held));
        }
        self.unfinished.write(bytes)?;
        self.hasher.update(bytes);
        self.held = held;
        Ok(())
    }

    /// Stores the complete blob, durably.
    ///
    /// # Errors
    /// Bytes are missing, and the blob stays as it is; or it has another digest, and is removed.
    pub fn finish(mut self) -> Result<(), BlobError> {
        if self.held < self.size {
            return Err(BlobError::Incomplete {
                held: self.held,
                size: self.size,
            });
        }
        self.unfinished.kept = false;
        check(&self.digest, self.hasher.finalize().into())?;
        self.unfinished.finish(&self.digest)
    }

    pub(super) fn discard(mut self) {
        self.unfinished.kept = false;
    }

    fn refuse(&mut self, size: u64) -> BlobError {
        self.unfinished.kept = false;
        BlobError::TooLarge {
            size,
            limit: self.size,
        }
    }
}
