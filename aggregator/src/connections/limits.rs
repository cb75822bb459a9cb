//! How many connections a server has, and how long they may last without a request.

use std::time::Duration;

/// How many connections a server has at most, if nobody says otherwise.
pub(super) const MOST: usize = 4096;

/// What a server allows its connections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionLimits {
    /// Connections at once.
    pub most: usize,
    /// How long the TLS handshake may take.
    pub handshake: Duration,
    /// How long a connection may have no request in progress.
    pub idle: Duration,
    /// How long open requests may take when the server ends.
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
