//! How many connections a server has, and how long they may last without a request.

use std::time::Duration;

/// How many connections a server has at most, if nobody says otherwise.
pub(super) const MOST: usize = 4096;

/// What a server allows its connections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionLimits {
    /// Connections at once.
    pub most: usize,
    /// Connections at once from one address: one IPv4 address, or one IPv6 network of 64 bits. This machine itself (127.0.0.1 and ::1) has no
    /// such limit.
    pub per_address: usize,
    /// How long the TLS handshake and the first bytes of HTTP may take together.
    pub handshake: Duration,
    /// How long a stranger's connection may have no request in progress.
    pub stranger_idle: Duration,
    /// How long a node's connection may have no request in progress.
    pub node_idle: Duration,
    /// How long open requests may take when the server ends.
    pub drain: Duration,
}

impl Default for ConnectionLimits {
    fn default() -> Self {
        Self {
            most: MOST,
            per_address: 16,
            handshake: Duration::from_secs(10),
            stranger_idle: Duration::from_secs(30),
            // A node is silent while it trains and proves. It would have to compete with strangers if it had to connect anew.
            node_idle: Duration::from_secs(3600),
            drain: Duration::from_secs(10),
        }
    }
}

/// How many connections of one node keep their places. Its other connections count as a stranger's.
pub const PLACES_PER_NODE: usize = 2;

impl ConnectionLimits {
    /// How many places nodes can keep. The rest stay open to strangers, because every node comes as a stranger.
    pub(super) fn most_of_nodes(&self) -> usize {
        self.most - self.most.div_ceil(8).min(self.most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zk0_protocol::rules::apply::MAX_COMMITS;

    #[test]
    fn every_node_of_the_largest_round_keeps_its_places() {
        assert!(MAX_COMMITS * PLACES_PER_NODE <= ConnectionLimits::default().most_of_nodes());
    }
}
