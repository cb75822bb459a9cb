//! How many requests may wait for the store of the blobs at once.

use crate::line::WorkQueue;
use crate::store_reads::StoreReads;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Semaphore;

/// How many requests may store blobs at once. Each of them holds some megabytes of its blob in memory.
const STORING: usize = 16;

/// How many downloads may read blobs from the store at once. Strangers may download, so these are places of their own.
const READING: usize = 8;

/// How many more downloads may wait for such a place.
const WAITING: usize = 64;

/// How many more downloads of nodes may wait for a place of theirs.
const NODES_WAITING: usize = 1024;

/// Places for work that waits for the store.
#[derive(Clone)]
pub(in crate::serve) struct BlobPlaces {
    pub(super) storing: Arc<Semaphore>,
    pub(super) reading: WorkQueue,
    /// As many for downloads of nodes: strangers do not hold them up.
    pub(super) reading_for_nodes: WorkQueue,
    pub(super) reads: StoreReads,
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
            reading_for_nodes: WorkQueue::new(READING, NODES_WAITING),
            reads: StoreReads::default(),
            cache_bytes: None,
            addresses: None,
        }
    }
}
