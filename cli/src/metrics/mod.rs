//! Options of services for their metrics, and the metrics' server.

use crate::serve::listening_if;
use anyhow::{Context, Result};
use std::future::{self, Future};
use std::net::SocketAddr;
use tokio::net::TcpListener;
use tokio::runtime::{Builder, Runtime};
use zk0_aggregator::publish::http::{self, HttpLimits};
use zk0_service::metrics::endpoint::{self, Observed};

/// Metrics.
#[derive(Debug, clap::Args)]
pub struct MetricsOptions {
    /// Serve metrics for Prometheus on this address, at /metrics, and at /health whether the service is in order; port 0 takes a free port. They
    /// are not encrypted, and they are for the operator alone, so listen only on this machine or on a private network. Off by default.
    #[arg(long, value_name = "ADDRESS")]
    pub metrics: Option<SocketAddr>,
}

impl MetricsOptions {
    /// Serves this service's metrics, if wanted.
    pub fn serve(&self, service: impl Observed) -> Result<()> {
        if let Some(listener) = listening_if(self.metrics)? {
            tokio::spawn(serve_metrics(listener, service));
        }
        Ok(())
    }

    /// [`Self::serve`] for a command without a runtime. The server ends with the returned one.
    pub fn serve_beside(&self, service: impl Observed) -> Result<Option<Runtime>> {
        if self.metrics.is_none() {
            return Ok(None);
        }
        let runtime = Builder::new_multi_thread()
            .worker_threads(1)
            .enable_all()
            .build()
            .context("starting the runtime")?;
        runtime.block_on(async { self.serve(service) })?;
        Ok(Some(runtime))
    }
}

/// Serves a service's metrics.
pub fn serve_metrics(
    (listener, address): (TcpListener, SocketAddr),
    service: impl Observed,
) -> impl Future<Output = ()> + Send + 'static {
    tracing::info!(metrics = %address, "the metrics are at http://{address}/metrics");
    if !address.ip().is_loopback() {
        tracing::warn!("whoever reaches {address} can read the metrics, which state how busy and how full this machine is");
    }
    let router = endpoint::router(service);
    http::serve(listener, router, HttpLimits::default(), future::pending())
}
