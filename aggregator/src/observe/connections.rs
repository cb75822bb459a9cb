//! Metrics of a server's connections.

use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use zk0_service::metrics::registry::MetricRegistry;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ConnectionLoss {
    OpenFiles,
    /// The handshake failed, or took too long.
    Handshake,
    /// Another connection got its place.
    MadeRoom,
}

#[derive(Clone, Default)]
pub(crate) struct ConnectionMetrics {
    pub open: Gauge,
    lost: Family<[(&'static str, &'static str); 1], Counter>,
}

impl ConnectionMetrics {
    pub fn registered(registry: &mut MetricRegistry) -> Self {
        let metrics = Self::default();
        registry.register("connections", "Open connections", metrics.open.clone());
        registry.register(
            "connections_lost",
            "Connections that were refused or closed, by the limit that did it",
            metrics.lost.clone(),
        );
        metrics
    }

    pub fn lost(&self, why: ConnectionLoss) {
        let limit = match why {
            ConnectionLoss::OpenFiles => "open-files",
            ConnectionLoss::Handshake => "handshake",
            ConnectionLoss::MadeRoom => "made-room",
        };
        self.lost.get_or_create(&[("limit", limit)]).inc();
    }
}
