//! HTTP/1.1 under limits, for a log's files and for a witness: the routes are axum's, the limits are set here.
//!
//! | what | limit |
//! |---|---|
//! | connections at once | [`Limits::connections`]; one request at a time on each |
//! | the head of a request | 16 KiB, within [`Limits::silence`] |
//! | its body | [`Limits::body`] bytes, within [`Limits::silence`] |
//! | a connection in all | [`Limits::lifetime`] |
//!
//! Traffic is not encrypted: put a TLS proxy before it.

use crate::connections::BoundedListener;
use axum::body::{to_bytes, Body};
use axum::extract::Request;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::http::StatusCode;
use axum::middleware::{from_fn, Next};
use axum::response::{IntoResponse, Response};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::future::Future;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};

pub use axum::Router;

/// What a server puts up with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Connections at once. Whoever connects beyond that waits to be accepted.
    pub connections: usize,
    /// How long a client may take to send a request, or to take the next part of a file.
    pub silence: Duration,
    /// How long a connection may last.
    pub lifetime: Duration,
    /// Largest body of a request, in bytes.
    pub body: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            connections: 32,
            silence: Duration::from_secs(20),
            lifetime: Duration::from_secs(600),
            body: 0,
        }
    }
}

/// Plain text.
pub(crate) const TEXT: &str = "text/plain; charset=utf-8";

/// For what never changes: caches may keep it for a year.
pub(crate) const IMMUTABLE: &str = "public, max-age=31536000, immutable";

/// For what changes: caches have to ask again each time.
pub(crate) const NO_CACHE: &str = "no-cache";

/// An answer with these bytes.
pub(crate) fn answer(
    status: u16,
    kind: &'static str,
    cache: &'static str,
    body: impl Into<Body>,
) -> Response {
    let status = StatusCode::from_u16(status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    let headers = [(CONTENT_TYPE, kind), (CACHE_CONTROL, cache)];
    (status, headers, body.into()).into_response()
}

/// An answer with a short text that caches must not keep.
pub(crate) fn text(status: u16, text: impl Into<String>) -> Response {
    answer(status, TEXT, NO_CACHE, text.into())
}

/// Serves on `listener` until `stop` is ready.
pub async fn serve(
    listener: TcpListener,
    router: Router,
    limits: Limits,
    stop: impl Future<Output = ()>,
) {
    let router = router.layer(from_fn(move |request, next| {
        with_whole_body(request, next, limits)
    }));
    let service = TowerToHyperService::new(router);
    let listener = BoundedListener::new(listener, limits.connections);
    let mut connections = JoinSet::new();
    tokio::pin!(stop);
    loop {
        while connections.try_join_next().is_some() {}
        let accepted = tokio::select! {
            () = &mut stop => break,
            accepted = listener.accept() => accepted,
        };
        let Ok(connection) = accepted else {
            // Most likely the process has no file descriptor left. Connections that end give some back.
            sleep(Duration::from_millis(100)).await;
            continue;
        };
        let connection = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(limits.silence)
            .max_buf_size(16 << 10)
            .serve_connection(TokioIo::new(connection), service.clone());
        // It is no event when a client goes away or takes too long.
        connections.spawn(timeout(limits.lifetime, connection));
    }
    connections.shutdown().await;
}

/// Hands a request on once its body is here.
async fn with_whole_body(request: Request, next: Next, limits: Limits) -> Response {
    let (head, body) = request.into_parts();
    match timeout(limits.silence, to_bytes(body, limits.body)).await {
        Err(_) => text(408, "the request's body took too long\n"),
        Ok(Err(_)) => text(
            413,
            format!("the request's body has more than {} bytes\n", limits.body),
        ),
        Ok(Ok(body)) => next.run(Request::from_parts(head, body.into())).await,
    }
}
