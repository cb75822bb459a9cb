//! The `zk0` command: thin shells over the crates that do the work.
//!
//! - [`audit`]: `zk0 audit replay`; [`ledger`]: a ledger as files, mirrors and proofs. All that an auditor's light build has.
//! - `governance`: proposals, votes, disputes.
//! - `node`, `aggregator`, `prover`, `witness`: the services (feature `full`).
//! - `train`, `eval`: a policy fitted to recordings, and measured on them; `frames`: what both make of recordings;
//!   `place`: where they compute.
//! - `dataset`: recordings, looked at and checked.
//! - `fidelity`: fixed-point against float32 losses; `calibration`: ranges chosen from recordings.
//! - `demo`: all of them as processes on one machine, and what is left of it: metrics, chart, log.
//! - [`logging`], [`chart`], [`keys`], `policy_source`: what they share.

pub mod audit;
pub mod ledger;
pub mod logging;

#[cfg(feature = "full")]
pub mod aggregator;
#[cfg(feature = "full")]
mod calibration;
#[cfg(feature = "full")]
pub mod chart;
#[cfg(feature = "full")]
pub mod dataset;
#[cfg(feature = "full")]
pub mod demo;
#[cfg(feature = "full")]
pub mod eval;
#[cfg(feature = "full")]
pub mod fidelity;
#[cfg(feature = "full")]
mod frames;
#[cfg(feature = "full")]
pub mod governance;
#[cfg(feature = "full")]
pub mod keys;
#[cfg(feature = "full")]
pub mod node;
#[cfg(feature = "full")]
mod place;
#[cfg(feature = "full")]
mod policy_source;
#[cfg(feature = "full")]
pub mod prover;
#[cfg(feature = "full")]
pub mod train;
#[cfg(feature = "full")]
pub mod witness;

/// Serves a log's files or a witness until the process is asked to end.
#[cfg(feature = "full")]
pub(crate) fn serve_http(
    what: &str,
    listen: std::net::SocketAddr,
    router: zk0_aggregator::publish::http::Router,
    limits: zk0_aggregator::publish::http::Limits,
) -> anyhow::Result<()> {
    use anyhow::Context;
    let runtime = tokio::runtime::Runtime::new().context("starting the runtime")?;
    runtime.block_on(async {
        let listener = tokio::net::TcpListener::bind(listen)
            .await
            .with_context(|| format!("listening on {listen}"))?;
        let address = listener.local_addr()?;
        tracing::info!(listening = %address, "{what} on http://{address}");
        zk0_aggregator::publish::http::serve(listener, router, limits, interrupted()).await;
        Ok(())
    })
}

/// Ready when the process is asked to end: Ctrl-C or SIGTERM.
#[cfg(feature = "full")]
pub(crate) async fn interrupted() {
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
