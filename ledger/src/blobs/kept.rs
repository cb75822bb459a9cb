//! Blobs that are kept in a store. The folder is a cache of the store then: a blob is in the store before it has its name in the folder, and
//! a blob that is not in the folder is read from the store.
//!
//! The store is trusted with nothing but keeping the bytes: whatever comes from it counts only if it has the digest in its name. Its list is
//! read once, so that nobody waits for the network to learn whether a blob exists. Only the ledger's writer adds to the store.

use super::error::{io_error, BlobError};
use super::store::{BlobStore, Kept};
use super::{check, check_file, Blobs};
use sha2::{Digest as _, Sha256};
use std::fs;
use std::io;
use std::path::Path;
use std::sync::Arc;
use zk0_circuits::Digest;

impl Blobs {
    /// The blobs of the ledger in `dir`, which are kept in `store`. Reads the store's list.
    pub fn in_store(dir: &Path, store: Box<dyn BlobStore>) -> Result<Self, BlobError> {
        Ok(Self {
            kept: Some(Arc::new(Kept::new(store)?)),
            ..Self::at(dir)
        })
    }

    /// The address of the store; `None` if the folder is the only place.
    pub fn store_address(&self) -> Option<&str> {
        self.kept.as_ref().map(|kept| kept.address())
    }

    /// Puts into the store what is only in the folder, and returns how many blobs these were. Only the ledger's writer may call this.
    /// A blob that is damaged is not stored.
    pub fn store_all(&self) -> Result<usize, BlobError> {
        let Some(kept) = &self.kept else {
            return Ok(0);
        };
        let mut stored = 0;
        for (blob, _) in self.all_here()? {
            if kept.knows(&blob) {
                continue;
            }
            match check_file(&blob, self.open_here(&blob)?) {
                Ok(()) => {
                    kept.put(&blob, &self.path(&blob))?;
                    stored += 1;
                }
                Err(damaged) => {
                    tracing::error!(%blob, "the blob is not put into the blob store: {damaged}")
                }
            }
        }
        Ok(stored)
    }

    /// Reads a blob from the store into the folder, if it is not here. Its digest is verified.
    ///
    /// # Errors
    /// There is no such blob, the store fails, or it has other bytes under this name.
    pub fn fetch(&self, blob: &Digest) -> Result<(), BlobError> {
        if self.is_here(blob) {
            return Ok(());
        }
        let Some(kept) = &self.kept else {
            return Err(BlobError::Missing(*blob));
        };
        kept.in_turn(blob, || match self.is_here(blob) {
            true => Ok(()),
            false => self.read_from(kept, blob),
        })
    }

    fn read_from(&self, kept: &Kept, blob: &Digest) -> Result<(), BlobError> {
        let size = kept.size(blob).ok_or(BlobError::Missing(*blob))?;
        let mut unfinished = self.begin()?;
        let (mut hasher, mut held) = (Sha256::new(), 0u64);
        kept.get(blob, size, &mut |bytes| {
            held = held.saturating_add(bytes.len() as u64);
            if held > size {
                return Err(kept.altered(blob, format!("more than {size} bytes")));
            }
            hasher.update(bytes);
            unfinished.write(bytes)
        })?;
        match check(blob, hasher.finalize().into()) {
            Ok(()) => unfinished.finish_here(blob),
            Err(BlobError::WrongDigest { actual, .. }) => {
                Err(kept.altered(blob, format!("bytes of SHA-256 {actual}")))
            }
            Err(other) => Err(other),
        }
    }

    /// Removes a blob, here and in the store. Only the ledger's writer may call this.
    pub fn remove(&self, blob: &Digest) -> Result<(), BlobError> {
        // In this order, whoever is killed in between leaves a blob that is still listed.
        self.remove_here(blob)?;
        match &self.kept {
            Some(kept) => Ok(kept.remove(blob)?),
            None => Ok(()),
        }
    }

    pub(super) fn remove_here(&self, blob: &Digest) -> Result<(), BlobError> {
        let path = self.path(blob);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(io_error(&path)(error)),
            _ => Ok(()),
        }
    }
}
