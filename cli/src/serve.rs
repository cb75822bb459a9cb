//! What the commands that serve share: serving over HTTP, and ending when they are told to.

use anyhow::{Context, Result};
use std::net::SocketAddr;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
use zk0_aggregator::publish::http::{self, Limits, Router};

/// Serves a log's files or a witness until the process is told to end.
pub fn serve_http(what: &str, listen: SocketAddr, router: Router, limits: Limits) -> Result<()> {
    let runtime = Runtime::new().context("starting the runtime")?;
    runtime.block_on(async {
        let listener = TcpListener::bind(listen)
            .await
            .with_context(|| format!("listening on {listen}"))?;
        let address = listener.local_addr()?;
        tracing::info!(listening = %address, "the {what} is served on http://{address}");
        http::serve(listener, router, limits, interrupted()).await;
        Ok(())
    })
}

/// Ready when the process is told to end, by Ctrl-C or by SIGTERM.
pub async fn interrupted() {
    use tokio::signal::unix::{signal, SignalKind};
    match signal(SignalKind::terminate()) {
        Ok(mut terminate) => tokio::select! {
            _ = tokio::signal::ctrl_c() => {}
            _ = terminate.recv() => {}
        },
        Err(_) => {
            let _ = tokio::signal::ctrl_c().await;
        }
    }
}
