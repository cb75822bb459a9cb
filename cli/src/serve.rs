//! What networked commands share: a runtime, listening, HTTP, and the end.

use crate::certificate::{keep_current, scheme, CertificateOptions};
use anyhow::{bail, Context, Result};
use std::future::Future;
use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener as SystemListener};
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::runtime::{self, Runtime};
use zk0_aggregator::connections::listening;
use zk0_aggregator::publish::http::{self, HttpLimits, Router};

/// Time at the end for work that cannot be stopped. What was acknowledged is on disk.
pub const ENDING: Duration = Duration::from_secs(2);

/// Runs a command on the network.
pub fn online<T>(work: impl Future<Output = Result<T>>) -> Result<T> {
    let runtime = Runtime::new().context("starting the runtime")?;
    runtime.block_on(work)
}

/// Runs a server. At the end, work that cannot be stopped has `patience`.
pub fn online_until<T>(patience: Duration, work: impl Future<Output = Result<T>>) -> Result<T> {
    let runtime = Runtime::new().context("starting the runtime")?;
    let done = runtime.block_on(work);
    runtime.shutdown_timeout(patience);
    done
}

/// Listens on this address, or on a free port. Returns the listener and its address.
pub fn listening(listen: SocketAddr) -> Result<(TcpListener, SocketAddr)> {
    let listener = match listening::listen(listen) {
        Err(error) if error.kind() == ErrorKind::AddrInUse => {
            bail!("another process listens on {listen} already: stop it, or choose another address")
        }
        bound => bound.with_context(|| format!("listening on {listen}"))?,
    };
    let address = listener.local_addr()?;
    Ok((listener, address))
}

/// [`listening`], where no runtime runs yet.
pub fn listening_early(listen: SocketAddr) -> Result<(SystemListener, SocketAddr)> {
    let runtime = runtime::Builder::new_current_thread().enable_io().build();
    let runtime = runtime.context("starting the runtime")?;
    let _entered = runtime.enter();
    let (listener, address) = listening(listen)?;
    Ok((listener.into_std()?, address))
}

/// [`listening`], if there is an address.
pub fn listening_if(listen: Option<SocketAddr>) -> Result<Option<(TcpListener, SocketAddr)>> {
    Ok(match listen {
        Some(listen) => Some(listening(listen)?),
        None => None,
    })
}

/// Serves until the process is told to end, and what `beside` starts.
pub fn serve_http(
    what: &str,
    listen: SocketAddr,
    certificate: &CertificateOptions,
    router: Router,
    limits: HttpLimits,
    beside: impl FnOnce() -> Result<()>,
) -> Result<()> {
    let certificate = certificate.load()?;
    let certificate = certificate.as_ref();
    online_until(ENDING, async {
        let stop = interrupted();
        let (listener, address) = listening(listen)?;
        beside()?;
        keep_current(certificate, what, address);
        let scheme = scheme(certificate);
        tracing::info!(listening = %address, "the {what} is served on {scheme}://{address}");
        http::serve_with(listener, router, limits, certificate, stop).await;
        Ok(())
    })
}

/// Ready on Ctrl-C or SIGTERM, which no longer end the process by themselves.
pub fn interrupted() -> impl Future<Output = ()> {
    use tokio::signal::unix::{signal, SignalKind};
    let told = [SignalKind::interrupt(), SignalKind::terminate()].map(signal);
    async move {
        let told = told.map(|signal| async move {
            match signal {
                Ok(mut signal) => drop(signal.recv().await),
                // This signal ends the process directly.
                Err(_) => std::future::pending().await,
            }
        });
        let [interrupted, terminated] = told;
        tokio::select! {
            () = interrupted => {}
            () = terminated => {}
        }
    }
}
