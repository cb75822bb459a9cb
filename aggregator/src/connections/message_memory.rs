//! The memory for large messages. A message takes its bytes before it is read, and gives them back when its request is answered.
//!
//! | whose message | where its bytes come from |
//! |---|---|
//! | anybody's, of at most [`SMALL_BYTES`] | nowhere: the number of requests in progress bounds them |
//! | a node's | the half for nodes, one message at a time for each node, over all its connections |
//! | a stranger's | the half for strangers, one message at a time for each address but this machine's own |

use crate::connections::caller::Caller;
use prometheus_client::metrics::gauge::Gauge;
use std::sync::Arc;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// A message of at most so many bytes is small.
pub(crate) const SMALL_BYTES: u64 = 32 << 10;

/// One permit of the semaphores.
const UNIT_BYTES: u64 = 1 << 10;

/// The memory for large messages that are being received and answered.
#[derive(Clone)]
pub(crate) struct MessageMemory {
    largest: u64,
    strangers: Arc<Semaphore>,
    nodes: Arc<Semaphore>,
    /// Counts the bytes that are reserved.
    in_flight: Gauge,
}

/// The memory of a message, until it is dropped.
pub(crate) struct Reserved {
    _bytes: OwnedSemaphorePermit,
    _turn: OwnedSemaphorePermit,
    _counted: CountedBytes,
}

/// Bytes that count as reserved, until this is dropped.
struct CountedBytes(Gauge, i64);

impl CountedBytes {
    fn new(in_flight: Gauge, units: u32) -> Self {
        let bytes = i64::from(units) * UNIT_BYTES as i64;
        in_flight.inc_by(bytes);
        Self(in_flight, bytes)
    }
}

impl Drop for CountedBytes {
    fn drop(&mut self) {
        self.0.dec_by(self.1);
    }
}

impl MessageMemory {
    /// Reserves at most `bytes` for messages of at most `largest` bytes. There is always room for one message of a node and one of a
    /// stranger.
    pub fn new(bytes: u64, largest: u64) -> Self {
        let half = || {
            let units = (bytes / 2).max(largest).div_ceil(UNIT_BYTES);
            let units = usize::try_from(units).unwrap_or(usize::MAX);
            Arc::new(Semaphore::new(units.min(Semaphore::MAX_PERMITS)))
        };
        Self {
            largest,
            strangers: half(),
            nodes: half(),
            in_flight: Gauge::default(),
        }
    }

    /// From now on, this counts the bytes that are reserved.
    pub fn counted_by(mut self, in_flight: Gauge) -> Self {
        self.in_flight = in_flight;
        self
    }

    /// The largest message that anybody decodes.
    pub fn largest(&self) -> u64 {
        self.largest
    }

    /// Waits until there is room for a large message of this caller. `None` if there never is.
    pub async fn reserve(self, caller: Caller, bytes: u64) -> Option<Reserved> {
        let units = u32::try_from(bytes.div_ceil(UNIT_BYTES)).ok()?;
        let (memory, turn) = match caller.turn_of_node() {
            Some(turn) => (self.nodes, turn),
            None => (self.strangers, caller.large),
        };
        // Who waits for its turn holds no memory.
        let turn = turn.acquire_owned().await.ok()?;
        Some(Reserved {
            _bytes: memory.acquire_many_owned(units).await.ok()?,
            _turn: turn,
            _counted: CountedBytes::new(self.in_flight, units),
        })
    }
}
