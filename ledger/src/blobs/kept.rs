//! Blobs in a store, with the folder as its cache: a blob is in the store before it has its name in the folder. Missing blobs are read from
//! the store.
//!
//! The store is trusted only to keep bytes: they must have the digest in their name. Its list is read once, so that the question whether a
//! blob exists needs no network. Only the ledger's writer adds to the store. A reader beside it ([`Blobs::beside_writer`]) asks the store
//! about each blob that is not in the folder.

use super::entry_objects::EntryStore;
use super::error::{io_error, BlobError};
use super::store::{BlobStore, IndexedStore};
use super::take::{ArrivingBlob, Follow};
use super::usage::{Amount, Usage};
use super::{check, check_file, Blobs, UnfinishedBlob};
use sha2::{Digest as _, Sha256};
use std::fs::{self, File};
use std::io;
use std::path::Path;
use std::sync::Arc;
use zk0_circuits::Digest;

impl Blobs {
    /// The blobs of the ledger in `dir`, kept in `store`. Reads the store's list.
    pub fn in_store(dir: &Path, store: Box<dyn BlobStore>) -> Result<Self, BlobError> {
        Ok(Self {
            kept: Some(Arc::new(IndexedStore::new(store, false)?)),
            ..Self::at(dir)
        })
    }

    /// The same for a reader, beside the ledger's writer.
    pub fn beside_writer(dir: &Path, store: Box<dyn BlobStore>) -> Result<Self, BlobError> {
        Ok(Self {
            kept: Some(Arc::new(IndexedStore::new(store, true)?)),
            ..Self::at(dir)
        })
    }

    /// What the store was asked for; `None` if the folder is the only place.
    pub fn usage(&self) -> Option<Usage> {
        self.kept.as_ref().map(|kept| kept.usage())
    }

    /// What the folder holds.
    pub fn here(&self) -> Result<Amount, BlobError> {
        Ok(Amount::of(&self.all_here()?))
    }

    /// What the store holds, as far as this process knows; `None` if the folder is the only place.
    pub fn stored(&self) -> Option<Amount> {
        let kept = self.kept.as_ref();
        kept.map(|kept| Amount::of(&kept.all()))
    }

    /// The address of the store; `None` if the folder is the only place.
    pub fn store_address(&self) -> Option<&str> {
        self.kept.as_ref().map(|kept| kept.address())
    }

    /// The store of the log's entries; `None` if the folder is the only place.
    pub(crate) fn entry_store(&self) -> Option<&dyn EntryStore> {
        self.kept.as_ref().map(|kept| kept.store.entries())
    }

    /// Puts undamaged blobs that are only in the folder into the store. Returns their number. Only for the ledger's writer.
    pub fn store_all(&self) -> Result<usize, BlobError> {
        let Some(kept) = &self.kept else {
            return Ok(0);
        };
        let mut stored = 0;
        // There may be very many, so nothing is asked about each.
        for (blob, ()) in self.each_here(|_| Ok(()))? {
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

    /// Reads a blob that is not here from the store into the folder, and verifies it.
    ///
    /// # Errors
    /// There is no such blob, the store fails, or it has other bytes under this name.
    pub fn fetch(&self, blob: &Digest) -> Result<(), BlobError> {
        self.fetch_followed(blob, &mut |_| Ok(()))
    }

    /// Like [`Self::fetch`]. `follow` hears of each part that comes, unless another thread is reading the blob already.
    ///
    /// # Errors
    /// Those of [`Self::fetch`] and of `follow`.
    pub fn fetch_followed(&self, blob: &Digest, follow: Follow<'_>) -> Result<(), BlobError> {
        if self.is_here(blob) {
            return Ok(());
        }
        let Some(kept) = &self.kept else {
            return Err(BlobError::Missing(*blob));
        };
        kept.in_turn(blob, || {
            if self.is_here(blob) {
                Ok(())
            } else {
                self.read_from(kept, blob, follow)?.finish_here(blob)
            }
        })
    }

    /// The file of a blob. If the folder lacks it, it is read from the store and verified, and does not stay.
    pub fn file_once(&self, blob: &Digest) -> Result<File, BlobError> {
        match (self.open_here(blob), &self.kept) {
            (Err(BlobError::Missing(_)), Some(kept)) => {
                let unfinished =
                    kept.in_turn(blob, || self.read_from(kept, blob, &mut |_| Ok(())))?;
                File::open(&unfinished.path).map_err(io_error(&unfinished.path))
            }
            (opened, _) => Ok(opened?.1),
        }
    }

    fn read_from(
        &self,
        kept: &IndexedStore,
        blob: &Digest,
        follow: Follow<'_>,
    ) -> Result<UnfinishedBlob, BlobError> {
        let size = kept.size(blob)?.ok_or(BlobError::Missing(*blob))?;
        let mut unfinished = self.begin()?;
        let file = unfinished.path.clone();
        kept.get(size, |store| {
            let (mut hasher, mut held) = (Sha256::new(), 0u64);
            store.get(blob, size, &mut |bytes| {
                held = held.saturating_add(bytes.len() as u64);
                if held > size {
                    return Err(kept.altered(blob, format!("more than {size} bytes")));
                }
                hasher.update(bytes);
                unfinished.write(bytes)?;
                follow(ArrivingBlob {
                    file: &file,
                    size,
                    held,
                })
            })?;
            match check(blob, hasher.finalize().into()) {
                Err(BlobError::WrongDigest { actual, .. }) => {
                    Err(kept.altered(blob, format!("bytes of SHA-256 {actual}")))
                }
                checked => checked,
            }
        })?;
        Ok(unfinished)
    }

    /// Whether a blob is where blobs are kept: in the store, or in the folder if that is the only place.
    pub fn is_kept(&self, blob: &Digest) -> bool {
        match &self.kept {
            Some(kept) => kept.knows(blob),
            None => self.is_here(blob),
        }
    }

    /// Removes a blob, here and in the store, once no thread reads it. Only for the ledger's writer.
    pub fn remove(&self, blob: &Digest) -> Result<(), BlobError> {
        let Some(kept) = &self.kept else {
            return self.remove_here(blob);
        };
        kept.in_turn(blob, || {
            // In this order, a killed process leaves a blob that is still listed.
            self.remove_here(blob)?;
            kept.remove(blob)
        })
    }

    pub(super) fn remove_here(&self, blob: &Digest) -> Result<(), BlobError> {
        let path = self.path(blob);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(io_error(&path)(error)),
            _ => Ok(()),
        }
    }
}
