//! How much a connection may send before the service has taken it: HTTP/2's window (RFC 9113, section 5.2).
//!
//! A peer sends at most one window in each round trip, so large windows make uploads from far away fast. But a peer can fill its window and
//! give no reason to take it. So connections share a bounded amount: more of them get smaller windows.

use std::sync::Arc;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Least window, in bytes.
const LEAST: u32 = 256 << 10;

/// Largest window, in bytes: 330 Mbit/s over a round trip of 100 ms.
const MOST: u32 = 4 << 20;

/// Kibibytes that connections share beside their least windows.
const SHARED_KIB: usize = 1 << 20;

/// A connection takes at most one part in so many of the rest, so that later ones get some.
const PARTS: usize = 64;

#[derive(Clone, Debug)]
pub(crate) struct Windows(Arc<Semaphore>);

/// A connection's window. Dropping it frees the memory.
#[derive(Debug)]
pub(crate) struct ConnectionWindow {
    /// In bytes.
    pub bytes: u32,
    _shared: Option<OwnedSemaphorePermit>,
}

impl Windows {
    pub fn new() -> Self {
        Self(Arc::new(Semaphore::new(SHARED_KIB)))
    }

    pub fn take(&self) -> ConnectionWindow {
        let part = u32::try_from(self.0.available_permits() / PARTS).unwrap_or(u32::MAX);
        let more = part.min((MOST - LEAST) >> 10);
        let shared = self.0.clone().try_acquire_many_owned(more).ok();
        ConnectionWindow {
            bytes: LEAST + shared.as_ref().map_or(0, |_| more << 10),
            _shared: shared,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_connections_have_large_windows_and_many_stay_within_what_is_shared() {
        let windows = Windows::new();
        let mut taken: Vec<_> = (0..4096).map(|_| windows.take()).collect();
        assert_eq!([taken[0].bytes, taken[200].bytes], [MOST, MOST]);
        assert_eq!(taken[4095].bytes, LEAST);
        let all: u64 = taken.iter().map(|window| u64::from(window.bytes)).sum();
        let shared = (SHARED_KIB as u64) << 10;
        assert!(all <= shared + 4096 * u64::from(LEAST), "{all}");
        // After they have left, a newcomer has a large one.
        taken.clear();
        assert_eq!(windows.take().bytes, MOST);
        assert_eq!(windows.0.available_permits(), SHARED_KIB);
    }
}
