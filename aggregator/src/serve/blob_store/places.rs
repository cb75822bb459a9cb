//! How many requests may wait for the store of the blobs.

use crate::line::WorkQueue;
use crate::store_reads::StoreReads;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Semaphore;

/// Requests that store blobs. Each holds some megabytes in memory.
const STORING: usize = 16;

/// Downloads that read from the store, apart from the others because strangers may download.
const READING: usize = 8;

/// Further downloads that wait.
const WAITING: usize = 64;

/// Further downloads of nodes that wait.
const NODES_WAITING: usize = 1024;

#[derive(Clone)]
pub(in crate::serve) struct BlobPlaces {
    pub(super) storing: Arc<Semaphore>,
    pub(super) reading: WorkQueue,
    /// As many for nodes' downloads, apart from strangers'.
    pub(super) reading_for_nodes: WorkQueue,
    pub(super) reads: StoreReads,
    /// Bytes of blobs in the ledger's folder; `None` for no limit.
    pub(super) cache_bytes: Option<u64>,
    /// Validity of the store's addresses for nodes; `None` for no addresses.
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
