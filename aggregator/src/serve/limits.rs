//! The limits of the gRPC service.

use crate::connections::limits::ConnectionLimits;
use std::time::Duration;

/// Requests in progress on one connection.
pub const CONCURRENT: usize = 4;

/// The limits of a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Connections at once, and their silence.
    pub connections: ConnectionLimits,
    /// Longest silence of a peer within a stream.
    pub silence: Duration,
    /// Time of a whole upload.
    pub upload: Duration,
    /// Time of a whole download.
    pub download: Duration,
    /// Longest time of one message.
    pub message: Duration,
    /// How long followers of a round, or of the service's health, are served. This bounds the cost of peers that are gone.
    pub watch: Duration,
    /// Bytes of large messages in progress: one half for nodes, the other for strangers.
    pub message_memory: u64,
    /// Allowed difference of a sender's clock.
    pub skew: Duration,
    /// How long the aggregator's clock may be behind before the service ends.
    pub clock_behind: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            connections: ConnectionLimits::default(),
            silence: Duration::from_secs(30),
            upload: Duration::from_secs(600),
            // Nodes go on after a cut. So even 2 GB at 1 Mbit/s arrive, in five requests.
            download: Duration::from_secs(3600),
            message: Duration::from_secs(60),
            watch: Duration::from_secs(300),
            message_memory: 512 << 20,
            skew: Duration::from_secs(120),
            clock_behind: Duration::from_secs(600),
        }
    }
}
