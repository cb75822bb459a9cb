//! How many connections a server has, and how long they idle.

use std::time::Duration;

pub(super) const MOST: usize = 4096;

/// Limits of connections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionLimits {
    /// Connections at once.
    pub most: usize,
    /// For the TLS handshake.
    pub handshake: Duration,
    /// Longest time without a request in progress.
    pub idle: Duration,
    /// For open requests when the server ends.
    pub drain: Duration,
}

impl Default for ConnectionLimits {
    fn default() -> Self {
        Self {
            most: MOST,
            handshake: Duration::from_secs(10),
            idle: Duration::from_secs(30),
            drain: Duration::from_secs(10),
        }
    }
}
