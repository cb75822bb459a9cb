//! A store outside the ledger's folder, such as a bucket of S3, in which blobs are kept, and what is known of it.

use super::entry_objects::EntryStore;
use super::error::{io_error, BlobError, StoreError};
use super::take::Take;
use super::unverified::{SentStore, VerifiedCopies};
use super::usage::{StoreOperation, Usage, UsageCounter};
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::fs;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use zk0_circuits::Digest;

/// A store outside the folder. Each method waits for the network, and gives up after a bounded time.
pub trait BlobStore: Debug + Send + Sync {
    /// Its address, without credentials.
    fn address(&self) -> &str;

    /// The network that it belongs to; `None` if it names none.
    fn network(&self) -> Result<Option<Digest>, StoreError>;

    /// Names the network that it belongs to, durably, unless it names one. Returns the network that it names now.
    fn name_network(&self, network: &Digest) -> Result<Digest, StoreError>;

    /// Stores a file's `size` bytes durably under the name of a blob.
    fn put(&self, blob: &Digest, file: &Path, size: u64) -> Result<(), StoreError>;

    /// Gives the bytes under the name of a blob of `size` bytes to `take`, in order, unverified.
    ///
    /// # Errors
    /// The store has another number of bytes under this name, or nothing, or fails; or `take` fails.
    fn get(&self, blob: &Digest, size: u64, take: Take) -> Result<(), BlobError>;

    /// How many bytes are under the name of a blob; `None` if there is no such object.
    fn size(&self, blob: &Digest) -> Result<Option<u64>, StoreError>;

    /// Removes a blob, if it is there.
    fn remove(&self, blob: &Digest) -> Result<(), StoreError>;

    /// All blobs, each with its size in bytes.
    fn all(&self) -> Result<Vec<(Digest, u64)>, StoreError>;

    /// What it does with the log's entries.
    fn entries(&self) -> &dyn EntryStore;

    /// Its operations for those who put files into it by themselves; `None` if it has none.
    fn sent(&self) -> Option<&dyn SentStore>;
}

#[derive(Debug)]
pub(super) struct IndexedStore {
    pub(super) store: Box<dyn BlobStore>,
    known: Mutex<BTreeMap<Digest, u64>>,
    /// Blobs being read. Other threads that need one wait.
    reading: Mutex<BTreeMap<Digest, Arc<Mutex<()>>>>,
    /// Whether another process may add and remove.
    pub(super) shared: bool,
    pub(super) copies: VerifiedCopies,
    counting: UsageCounter,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A panic elsewhere leaves these maps whole.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl IndexedStore {
    pub(super) fn new(store: Box<dyn BlobStore>, shared: bool) -> Result<Self, BlobError> {
        let counting = UsageCounter::default();
        let list = || store.all().map_err(BlobError::from);
        let list = counting.count(StoreOperation::List, list, |_| 0)?;
        Ok(Self {
            store,
            known: Mutex::new(list.into_iter().collect()),
            reading: Mutex::default(),
            shared,
            copies: VerifiedCopies::default(),
            counting,
        })
    }

    pub(super) fn usage(&self) -> Usage {
        self.counting.now()
    }

    pub(super) fn address(&self) -> &str {
        self.store.address()
    }

    pub(super) fn sent(&self) -> Option<&dyn SentStore> {
        self.store.sent()
    }

    pub(super) fn counted<T>(
        &self,
        operation: StoreOperation,
        work: impl FnOnce() -> Result<T, BlobError>,
        bytes: impl FnOnce(&T) -> u64,
    ) -> Result<T, BlobError> {
        self.counting.count(operation, work, bytes)
    }

    pub(super) fn knows(&self, blob: &Digest) -> bool {
        locked(&self.known).contains_key(blob)
    }

    /// A blob's size in bytes, as far as known.
    pub(super) fn known_size(&self, blob: &Digest) -> Option<u64> {
        locked(&self.known).get(blob).copied()
    }

    pub(super) fn all(&self) -> Vec<(Digest, u64)> {
        let known = locked(&self.known);
        known.iter().map(|(blob, size)| (*blob, *size)).collect()
    }

    /// Stores a file whose digest is verified. A verified copy in the store saves sending it.
    pub(super) fn put(&self, blob: &Digest, file: &Path) -> Result<(), BlobError> {
        let size = fs::metadata(file).map_err(io_error(file))?.len();
        let put = || {
            if self.copies.make_blob(self.store.sent(), blob, size) {
                Ok(())
            } else {
                self.store.put(blob, file, size).map_err(BlobError::from)
            }
        };
        self.in_turn(blob, || {
            self.counting.count(StoreOperation::Put, put, |()| size)?;
            locked(&self.known).insert(*blob, size);
            Ok(())
        })
    }

    /// A blob's size in bytes; `None` if the store lacks it. Asks the store if it is shared.
    pub(super) fn size(&self, blob: &Digest) -> Result<Option<u64>, BlobError> {
        if !self.shared {
            return Ok(locked(&self.known).get(blob).copied());
        }
        let ask = || self.store.size(blob).map_err(BlobError::from);
        let found = self.counting.count(StoreOperation::Size, ask, |_| 0)?;
        let mut known = locked(&self.known);
        match found {
            Some(size) => known.insert(*blob, size),
            None => known.remove(blob),
        };
        Ok(found)
    }

    pub(super) fn get(
        &self,
        size: u64,
        read: impl FnOnce(&dyn BlobStore) -> Result<(), BlobError>,
    ) -> Result<(), BlobError> {
        let get = || read(&*self.store);
        self.counting.count(StoreOperation::Get, get, |()| size)
    }

    /// Removes a blob. If that fails, it stays known, for a later try.
    pub(super) fn remove(&self, blob: &Digest) -> Result<(), BlobError> {
        let remove = || self.store.remove(blob).map_err(BlobError::from);
        self.counting
            .count(StoreOperation::Remove, remove, |()| 0)?;
        locked(&self.known).remove(blob);
        Ok(())
    }

    /// Runs `work` while no other thread reads, stores or removes this blob.
    pub(super) fn in_turn<T>(&self, blob: &Digest, work: impl FnOnce() -> T) -> T {
        let turn = locked(&self.reading).entry(*blob).or_default().clone();
        let done = {
            let _alone = locked(&turn);
            work()
        };
        let mut reading = locked(&self.reading);
        // One is in the map, one is here: no other thread waits.
        if Arc::strong_count(&turn) == 2 {
            reading.remove(blob);
        }
        done
    }

    pub(super) fn altered(&self, blob: &Digest, found: String) -> BlobError {
        BlobError::Altered {
            address: self.store.address().into(),
            blob: *blob,
            found,
        }
    }
}
