//! Accepts connections and serves them in their places. Idle ones are closed. The end leaves a bounded time for answers.

use crate::connections::limits::ConnectionLimits;
use crate::connections::places::{ConnectionSlots, Seat};
use crate::connections::windows::Windows;
use crate::observe::connections::{ConnectionLoss, ConnectionMetrics};
use axum::body::Body;
use axum::Router;
use hyper::body::Incoming;
use hyper::service::{service_fn, Service};
use hyper::Request;
use hyper_util::rt::{TokioExecutor, TokioIo};
use hyper_util::server::conn::auto::Builder;
use hyper_util::service::TowerToHyperService;
use std::future::Future;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::{sleep, sleep_until, timeout, Instant};
use zk0_service::tls::server_certificate::Acceptor;

/// For a closing connection without a request in progress.
const CLOSING: Duration = Duration::from_secs(1);

/// How often the log states that connections are refused.
const SAY_AGAIN: Duration = Duration::from_secs(60);

trait Duplex: AsyncRead + AsyncWrite + Send + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Unpin> Duplex for T {}

pub(crate) struct Serving {
    pub limits: ConnectionLimits,
    pub protocol: Builder<TokioExecutor>,
    /// How much each may send before it is taken, in HTTP/2.
    pub windows: Windows,
    /// Requests in progress on one connection.
    pub requests: usize,
    pub tls: Option<Acceptor>,
    pub router: Router,
    pub metrics: ConnectionMetrics,
}

impl Serving {
    /// Serves on `listener` until `stop` is ready, then drains the open requests within the limits.
    pub async fn serve(self, listener: TcpListener, stop: impl Future<Output = ()>) {
        let drain = self.limits.drain;
        let places = ConnectionSlots::new(&self.limits, self.metrics.open.clone());
        let (stopping, stopped) = watch::channel(false);
        let (serving, mut connections) = (Arc::new(self), JoinSet::new());
        let (mut stop, mut reported) = (pin!(stop), None);
        loop {
            while connections.try_join_next().is_some() {}
            let accepted = tokio::select! {
                () = &mut stop => break,
                accepted = listener.accept() => accepted,
            };
            match accepted {
                Ok((stream, peer)) => {
                    let seat = places.enter(peer.ip());
                    let (serving, stopped) = (serving.clone(), stopped.clone());
                    connections.spawn(serving.seated(stream, seat, stopped));
                }
                // Most likely no file descriptor is left. Ending connections free some.
                Err(error) => {
                    serving.metrics.lost(ConnectionLoss::OpenFiles);
                    if reported.is_none_or(|at: Instant| at.elapsed() >= SAY_AGAIN) {
                        tracing::warn!("a connection is refused: {error}");
                        reported = Some(Instant::now());
                    }
                    sleep(Duration::from_millis(100)).await;
                }
            }
        }
        drop(listener);
        stopping.send_replace(true);
        let drained = async { while connections.join_next().await.is_some() {} };
        if timeout(drain, drained).await.is_err() {
            let open = connections.len();
            tracing::warn!("{open} connections are cut: their requests took more than {drain:?}");
        }
        connections.shutdown().await;
    }

    /// Serves until the connection ends, or makes room.
    async fn seated(
        self: Arc<Self>,
        stream: TcpStream,
        seat: Seat,
        stopped: watch::Receiver<bool>,
    ) {
        tokio::select! {
            () = seat.evicted() => self.metrics.lost(ConnectionLoss::MadeRoom),
            () = self.connection(stream, &seat, stopped) => {}
        }
    }

    async fn connection(&self, stream: TcpStream, seat: &Seat, mut stopped: watch::Receiver<bool>) {
        let _ = stream.set_nodelay(true);
        let stream: Box<dyn Duplex> = match &self.tls {
            None => Box::new(stream),
            Some(tls) => tokio::select! {
                encrypted = timeout(self.limits.handshake, tls.accept(stream)) => match encrypted {
                    Ok(Ok(encrypted)) => Box::new(encrypted),
                    // Clients often leave, take too long, or do not speak TLS.
                    failed => {
                        self.metrics.lost(ConnectionLoss::Handshake);
                        let why = failed.map(Result::err);
                        return tracing::debug!("a TLS handshake failed: {why:?}");
                    }
                },
                () = told(&mut stopped) => return,
            },
        };
        let connection = seat.connection(self.requests);
        let router = TowerToHyperService::new(self.router.clone());
        let service = service_fn(move |mut request: Request<Incoming>| {
            request.extensions_mut().insert(connection.clone());
            router.call(request.map(Body::new))
        });
        let (mut protocol, window) = (self.protocol.clone(), self.windows.take());
        protocol
            .http2()
            .initial_connection_window_size(window.bytes)
            .initial_stream_window_size(window.bytes);
        let connection = protocol.serve_connection(TokioIo::new(stream), service);
        let mut connection = pin!(connection);
        loop {
            let now = Instant::now();
            // During a request, nothing is due.
            let due = seat.idle_until().unwrap_or(now + self.limits.idle);
            if due <= now {
                break;
            }
            tokio::select! {
                _ = &mut connection => return,
                () = sleep_until(due) => {}
                () = told(&mut stopped) => break,
            }
        }
        connection.as_mut().graceful_shutdown();
        if seat.idle_until().is_some() {
            let _ = timeout(CLOSING, connection).await;
        } else {
            // The server cuts it if this takes too long.
            let _ = connection.await;
        }
    }
}

async fn told(stopped: &mut watch::Receiver<bool>) {
    let _ = stopped.wait_for(|stopped| *stopped).await;
}
