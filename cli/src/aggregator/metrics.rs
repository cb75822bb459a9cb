//! Options of `zk0 aggregator serve` for its metrics.

use std::future;
use std::net::SocketAddr;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use zk0_aggregator::observe::endpoint;
use zk0_aggregator::publish::http::{self, HttpLimits};
use zk0_aggregator::Service;

/// Metrics.
#[derive(Debug, clap::Args)]
pub struct MetricsOptions {
    /// Serve metrics for Prometheus on this address, at /metrics; port 0 takes a free port. They are not encrypted, and they are for the
    /// operator alone, so listen only on this machine or on a private network. Off by default.
    #[arg(long, value_name = "ADDRESS")]
    pub metrics: Option<SocketAddr>,
}

/// Serves a service's metrics.
pub fn serve_metrics(
    (listener, address): (TcpListener, SocketAddr),
    service: &Service,
) -> JoinHandle<()> {
    tracing::info!(metrics = %address, "the metrics are at http://{address}/metrics");
    if !address.ip().is_loopback() {
        tracing::warn!("whoever reaches {address} can read the metrics, which say how busy and how full this machine is");
    }
    let router = endpoint::router(service.clone());
    let serving = http::serve(listener, router, HttpLimits::default(), future::pending());
    let troubles = service.troubles().clone();
    tokio::spawn(troubles.supervised("the server of the metrics", serving))
}
