//! The memory for large messages. A message reserves its bytes before it is read, until its request is answered.
//!
//! | whose message | where its bytes come from |
//! |---|---|
//! | anybody's, of at most [`SMALL_BYTES`] | nowhere: the number of requests in progress bounds them |
//! | a node's | the half for nodes, one message at a time for each node, over all its connections |
//! | a stranger's | the half for strangers, one message at a time for each address but this machine's own, which may be a proxy's |

use crate::connections::caller::CallerId;
use crate::turns::KeyedTurns;
use prometheus_client::metrics::gauge::Gauge;
use std::net::{Ipv4Addr, Ipv6Addr};
use std::sync::Arc;
use tokio::sync::{OwnedMutexGuard, OwnedSemaphorePermit, Semaphore};

/// Largest small message, in bytes.
pub(crate) const SMALL_BYTES: u64 = 32 << 10;

const UNIT_BYTES: u64 = 1 << 10;

#[derive(Clone)]
pub(crate) struct MessageMemory {
    largest: u64,
    strangers: Arc<Semaphore>,
    nodes: Arc<Semaphore>,
    turns: KeyedTurns<CallerId>,
    in_flight: Gauge,
}

pub(crate) struct Reserved {
    pub bytes: u64,
    in_flight: Gauge,
    _permits: OwnedSemaphorePermit,
    _turn: Option<OwnedMutexGuard<()>>,
}

impl MessageMemory {
    /// Reserves and counts at most `bytes` for messages of at most `largest` bytes. One of a node and one of a stranger always fit.
    pub fn new(bytes: u64, largest: u64, in_flight: Gauge) -> Self {
        let half = || {
            let units = (bytes / 2).max(largest).div_ceil(UNIT_BYTES);
            let units = usize::try_from(units).unwrap_or(usize::MAX);
            Arc::new(Semaphore::new(units.min(Semaphore::MAX_PERMITS)))
        };
        Self {
            largest,
            strangers: half(),
            nodes: half(),
            turns: KeyedTurns::default(),
            in_flight,
        }
    }

    pub fn largest(&self) -> u64 {
        self.largest
    }

    /// Waits for room for a large message. `None` if there never is.
    pub async fn reserve(&self, caller: CallerId, bytes: u64) -> Option<Reserved> {
        let units = u32::try_from(bytes.div_ceil(UNIT_BYTES)).ok()?;
        let (memory, alone) = match caller {
            CallerId::Node(_) => (&self.nodes, true),
            CallerId::Stranger(address) => {
                let here = address == Ipv4Addr::LOCALHOST || address == Ipv6Addr::LOCALHOST;
                (&self.strangers, !here)
            }
        };
        // Waiting for a turn holds no memory.
        let turn = if alone {
            Some(self.turns.take(caller).await)
        } else {
            None
        };
        let permits = memory.clone().acquire_many_owned(units).await.ok()?;
        let bytes = u64::from(units) * UNIT_BYTES;
        self.in_flight.inc_by(bytes as i64);
        Some(Reserved {
            bytes,
            in_flight: self.in_flight.clone(),
            _permits: permits,
            _turn: turn,
        })
    }
}

impl Drop for Reserved {
    fn drop(&mut self) {
        self.in_flight.dec_by(self.bytes as i64);
    }
}
