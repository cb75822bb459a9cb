//! How many requests may wait for the store of the blobs at once.

use crate::line::WorkQueue;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Semaphore;

/// How many requests may store blobs at once. Each of them holds some megabytes of its blob in memory.
const STORING: usize = 16;

/// How many downloads may read blobs from the store at once. Strangers may download, so these are places of their own.
const READING: usize = 8;

/// How many more downloads may wait for such a place.
const WAITING: usize = 64;

/// Places for work that waits for the store.
#[derive(Clone)]
pub(in crate::serve) struct BlobPlaces {
    pub(super) storing: Arc<Semaphore>,
    pub(super) reading: WorkQueue,
    /// How many bytes of blobs the ledger's folder may hold; `None` for no limit.
    pub(super) cache_bytes: Option<u64>,
    /// For how long nodes get addresses of the store; `None` for no addresses.
    pub(super) addresses: Option<Duration>,
}

impl Default for BlobPlaces {
    fn default() -> Self {
        Self {
            storing: Arc::new(Semaphore::new(STORING)),
            reading: WorkQueue::new(READING, WAITING),
            cache_bytes: None,
            addresses: None,
        }
    }
}
