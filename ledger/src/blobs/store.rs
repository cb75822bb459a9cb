//! A store outside the ledger's folder, such as a bucket of S3, in which blobs are kept, and what is known of its content.

use super::error::{io_error, BlobError, StoreError};
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::fs;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use zk0_circuits::Digest;

/// Takes the bytes of a blob, part after part.
pub type Take<'a> = &'a mut (dyn FnMut(&[u8]) -> Result<(), BlobError> + Send);

/// A store outside the folder. Each method waits for the network, and gives up after a bounded time.
pub trait BlobStore: Debug + Send + Sync {
    /// Its address, without credentials.
    fn address(&self) -> &str;

    /// Stores the `size` bytes of a file under the name of a blob. They are durable when this returns.
    fn put(&self, blob: &Digest, file: &Path, size: u64) -> Result<(), StoreError>;

    /// Gives what is stored under the name of a blob of `size` bytes to `take`, in order. The bytes are not verified.
    ///
    /// # Errors
    /// The store has another number of bytes under this name, or nothing, or fails; or `take` fails.
    fn get(&self, blob: &Digest, size: u64, take: Take) -> Result<(), BlobError>;

    /// Removes a blob, if it is there.
    fn remove(&self, blob: &Digest) -> Result<(), StoreError>;

    /// All blobs, each with its size in bytes.
    fn all(&self) -> Result<Vec<(Digest, u64)>, StoreError>;
}

/// A store, and what is in it.
#[derive(Debug)]
pub(super) struct Kept {
    store: Box<dyn BlobStore>,
    known: Mutex<BTreeMap<Digest, u64>>,
    /// The blobs that are being read. Whoever needs one of them waits, and need not read it too.
    reading: Mutex<BTreeMap<Digest, Arc<Mutex<()>>>>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A panic elsewhere does not spoil these maps: they are never half changed.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Kept {
    /// A store with this content.
    pub(super) fn new(store: Box<dyn BlobStore>) -> Result<Self, StoreError> {
        let known = Mutex::new(store.all()?.into_iter().collect());
        Ok(Self {
            store,
            known,
            reading: Mutex::default(),
        })
    }

    pub(super) fn address(&self) -> &str {
        self.store.address()
    }

    pub(super) fn knows(&self, blob: &Digest) -> bool {
        locked(&self.known).contains_key(blob)
    }

    pub(super) fn all(&self) -> Vec<(Digest, u64)> {
        let known = locked(&self.known);
        known.iter().map(|(blob, size)| (*blob, *size)).collect()
    }

    /// Stores a file whose digest is verified.
    pub(super) fn put(&self, blob: &Digest, file: &Path) -> Result<(), BlobError> {
        let size = fs::metadata(file).map_err(io_error(file))?.len();
        self.store.put(blob, file, size)?;
        locked(&self.known).insert(*blob, size);
        Ok(())
    }

    /// How many bytes a blob has.
    pub(super) fn size(&self, blob: &Digest) -> Option<u64> {
        locked(&self.known).get(blob).copied()
    }

    /// Gives the bytes of a blob of this size to `take`. They are not verified.
    pub(super) fn get(&self, blob: &Digest, size: u64, take: Take) -> Result<(), BlobError> {
        self.store.get(blob, size, take)
    }

    /// Removes a blob. If that fails, the blob is still known, so that it can be removed later.
    pub(super) fn remove(&self, blob: &Digest) -> Result<(), StoreError> {
        self.store.remove(blob)?;
        locked(&self.known).remove(blob);
        Ok(())
    }

    /// Runs `read` when nobody else reads this blob.
    pub(super) fn in_turn<T>(&self, blob: &Digest, read: impl FnOnce() -> T) -> T {
        let turn = locked(&self.reading).entry(*blob).or_default().clone();
        let done = {
            let _alone = locked(&turn);
            read()
        };
        let mut reading = locked(&self.reading);
        // One is in the map, one is here: nobody else waits.
        if Arc::strong_count(&turn) == 2 {
            reading.remove(blob);
        }
        done
    }

    /// The store has something else under the name of a blob.
    pub(super) fn altered(&self, blob: &Digest, found: String) -> BlobError {
        BlobError::Altered {
            address: self.store.address().into(),
            blob: *blob,
            found,
        }
    }
}
