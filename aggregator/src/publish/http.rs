//! HTTP/1.1 under limits, for a log's files and for a witness, with axum's routes.
//!
//! | what | limit |
//! |---|---|
//! | connections at once | [`HttpLimits::connections`]; one request at a time on each |
//! | the head of a request | 16 KiB, within [`HttpLimits::silence`] |
//! | its body | [`HttpLimits::body`] bytes, within [`HttpLimits::silence`] |
//! | how long an answer may take | [`HttpLimits::answer`], and longer for a large one |
//!
//! [`serve`] does not encrypt. [`serve_with`] does so if it has a certificate.

use crate::connections::answer_body::keeping;
use crate::connections::limits::ConnectionLimits;
use crate::connections::places::ServedConnection;
use crate::connections::serving::Serving;
use crate::connections::windows::Windows;
use crate::observe::connections::ConnectionMetrics;
use axum::body::{to_bytes, Body};
use axum::extract::Request;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::http::StatusCode;
use axum::middleware::{from_fn, Next};
use axum::response::{IntoResponse, Response};
use futures_core::future::BoxFuture;
use hyper_util::rt::{TokioExecutor, TokioTimer};
use hyper_util::server::conn::auto::Builder;
use std::future::Future;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::time::timeout;
use zk0_service::tls::server_certificate::ServerCertificate;

pub use axum::Router;

/// The limits of a server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HttpLimits {
    /// Connections at once, and their silence.
    pub connections: ConnectionLimits,
    /// For sending a request, or taking the next part of a file.
    pub silence: Duration,
    /// For taking an answer, plus a second for each megabyte.
    pub answer: Duration,
    /// Largest request body, in bytes.
    pub body: usize,
}

const MOST_CONNECTIONS: usize = 256;

impl Default for HttpLimits {
    fn default() -> Self {
        Self {
            connections: ConnectionLimits {
                most: MOST_CONNECTIONS,
                ..ConnectionLimits::default()
            },
            silence: Duration::from_secs(20),
            answer: Duration::from_secs(600),
            body: 0,
        }
    }
}

pub(crate) const TEXT: &str = "text/plain; charset=utf-8";

/// For what never changes: kept a year.
pub(crate) const IMMUTABLE: &str = "public, max-age=31536000, immutable";

/// For what changes: asked for each time.
pub(crate) const NO_CACHE: &str = "no-cache";

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

pub(crate) fn text(status: u16, text: impl Into<String>) -> Response {
    answer(status, TEXT, NO_CACHE, text.into())
}

/// Serves on `listener` until `stop` is ready. Boxed, so that a crate that awaits it does not compile the server again.
pub fn serve<'a>(
    listener: TcpListener,
    router: Router,
    limits: HttpLimits,
    stop: impl Future<Output = ()> + Send + 'a,
) -> BoxFuture<'a, ()> {
    serve_with(listener, router, limits, None, stop)
}

/// Serves on `listener` until `stop` is ready, over TLS with a certificate.
pub fn serve_with<'a>(
    listener: TcpListener,
    router: Router,
    limits: HttpLimits,
    certificate: Option<&'a Arc<ServerCertificate>>,
    stop: impl Future<Output = ()> + Send + 'a,
) -> BoxFuture<'a, ()> {
    serve_until(listener, router, limits, certificate, Box::pin(stop))
}

fn serve_until<'a>(
    listener: TcpListener,
    router: Router,
    limits: HttpLimits,
    certificate: Option<&'a Arc<ServerCertificate>>,
    stop: BoxFuture<'a, ()>,
) -> BoxFuture<'a, ()> {
    Box::pin(served(listener, router, limits, certificate, stop))
}

async fn served(
    listener: TcpListener,
    router: Router,
    limits: HttpLimits,
    certificate: Option<&Arc<ServerCertificate>>,
    stop: BoxFuture<'_, ()>,
) {
    let tls = certificate.map(|certificate| certificate.acceptor("http/1.1"));
    let mut protocol = Builder::new(TokioExecutor::new()).http1_only();
    protocol
        .http1()
        .timer(TokioTimer::new())
        .header_read_timeout(limits.silence)
        .max_buf_size(16 << 10);
    let serving = Serving {
        limits: limits.connections,
        protocol,
        windows: Windows::new(),
        requests: 1,
        tls,
        metrics: ConnectionMetrics::default(),
        router: router.layer(from_fn(move |request, next| {
            with_whole_body(request, next, limits)
        })),
    };
    serving.serve(listener, stop).await;
}

async fn with_whole_body(request: Request, next: Next, limits: HttpLimits) -> Response {
    let (head, body) = request.into_parts();
    let progress = head.extensions.get().map(ServedConnection::begin);
    let response = match timeout(limits.silence, to_bytes(body, limits.body)).await {
        Err(_) => text(408, "the request's body took too long\n"),
        Ok(Err(_)) => text(
            413,
            format!("the request's body has more than {} bytes\n", limits.body),
        ),
        Ok(Ok(body)) => next.run(Request::from_parts(head, body.into())).await,
    };
    keeping(response, progress)
}
