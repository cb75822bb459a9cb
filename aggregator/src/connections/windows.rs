//! How much a connection may send before the service has taken it: HTTP/2's window (RFC 9113, section 5.2).
//!
//! A peer sends at most one window in each round trip, so an upload from far away is as fast as its window is large. But whoever sends
//! and gives the service no reason to take it holds a window of its memory. So connections share a bounded amount: while there are few, each has
//! a large window, and when there are many, new ones have small ones.

use std::sync::{Arc, Mutex};

/// Bytes that every connection has.
const LEAST: u32 = 256 << 10;

/// Bytes that a connection has at most: 330 Mbit/s over a round trip of 100 ms.
const MOST: u32 = 4 << 20;

/// Bytes that connections share beside the least of each.
const SHARED: u64 = 1 << 30;

/// What a connection takes of the rest at most: one part in so many. So something is left for those who come later.
const PARTS: u64 = 64;

/// What connections share.
#[derive(Clone, Debug)]
pub(crate) struct Windows {
    left: Arc<Mutex<u64>>,
}

/// The window of a connection. When it is dropped, others can have its memory.
#[derive(Debug)]
pub(crate) struct ConnectionWindow {
    /// In bytes.
    pub bytes: u32,
    of: Windows,
}

impl Windows {
    pub fn new() -> Self {
        Self {
            left: Arc::new(Mutex::new(SHARED)),
        }
    }

    /// The window of a new connection.
    pub fn take(&self) -> ConnectionWindow {
        let mut left = self.left.lock().unwrap_or_else(|e| e.into_inner());
        let more = (*left / PARTS).min(u64::from(MOST - LEAST));
        *left -= more;
        ConnectionWindow {
            bytes: LEAST + more as u32,
            of: self.clone(),
        }
    }
}

impl Drop for ConnectionWindow {
    fn drop(&mut self) {
        let mut left = self.of.left.lock().unwrap_or_else(|e| e.into_inner());
        *left += u64::from(self.bytes - LEAST);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_connections_have_large_windows_and_many_stay_within_what_is_shared() {
        let windows = Windows::new();
        let mut taken: Vec<_> = (0..4096).map(|_| windows.take()).collect();
        assert_eq!(taken[0].bytes, MOST);
        assert_eq!(taken[200].bytes, MOST);
        assert_eq!(taken[4095].bytes, LEAST);
        let all: u64 = taken.iter().map(|window| u64::from(window.bytes)).sum();
        assert!(all <= SHARED + 4096 * u64::from(LEAST), "{all}");
        // Whoever comes when they have left has a large one again.
        taken.clear();
        assert_eq!(windows.take().bytes, MOST);
        assert_eq!(*windows.left.lock().unwrap(), SHARED);
    }
}
