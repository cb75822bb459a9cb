//! How much a connection may send before the service has taken it: HTTP/2's window (RFC 9113, section 5.2).
//!
//! A peer sends at most one window in each round trip, so an upload from far away is as fast as its window is large. But whoever sends
//! and gives the service no reason to take it holds a window of its memory. So connections share a bounded amount: while there are few, each has
//! a large window, and when there are many, new ones have small ones.

use std::sync::Arc;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Bytes that every connection has.
const LEAST: u32 = 256 << 10;

/// Bytes that a connection has at most: 330 Mbit/s over a round trip of 100 ms.
const MOST: u32 = 4 << 20;

/// Kibibytes that connections share beside the least of each.
const SHARED_KIB: usize = 1 << 20;

/// What a connection takes of the rest at most: one part in so many. So something is left for those who come later.
const PARTS: usize = 64;

/// What connections share.
#[derive(Clone, Debug)]
pub(crate) struct Windows(Arc<Semaphore>);

/// The window of a connection. When it is dropped, others can have its memory.
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

    /// The window of a new connection.
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
        // Whoever comes when they have left has a large one again.
        taken.clear();
        assert_eq!(windows.take().bytes, MOST);
        assert_eq!(windows.0.available_permits(), SHARED_KIB);
    }
}
