//! What the gRPC service puts up with.

use crate::connections::limits::ConnectionLimits;
use std::time::Duration;

/// How many requests of one connection may be in progress.
pub const CONCURRENT: usize = 4;

/// What a service puts up with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Connections at once, and how long they may be silent.
    pub connections: ConnectionLimits,
    /// How long a peer may be silent in the middle of a stream.
    pub silence: Duration,
    /// How long an upload may take in all.
    pub upload: Duration,
    /// How long a download may take in all.
    pub download: Duration,
    /// How long one message may take.
    pub message: Duration,
    /// How long those who follow a round, or watch the service's health, are told of changes before they have to ask again. So nobody who is gone is
    /// served for longer.
    pub watch: Duration,
    /// Bytes of large messages that are received or answered at once. One half is for nodes, the other for strangers.
    pub message_memory: u64,
    /// How much the clock of a request's sender may differ from the aggregator's.
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
            // Nodes go on where they were cut. So even 2 GB at 1 Mbit/s arrive, in five requests.
            download: Duration::from_secs(3600),
            message: Duration::from_secs(60),
            watch: Duration::from_secs(300),
            message_memory: 512 << 20,
            skew: Duration::from_secs(120),
            clock_behind: Duration::from_secs(600),
        }
    }
}
