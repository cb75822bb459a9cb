//! A small HTTP/1.1 server over hyper, with limits before work: for a log's files and for a witness.
//!
//! | what | limit |
//! |---|---|
//! | connections at once | [`Limits::connections`]; one request at a time on each |
//! | the head of a request | 16 KiB, within [`Limits::silence`] |
//! | its body | [`Limits::body`] bytes, within [`Limits::silence`] |
//! | a connection in all | [`Limits::lifetime`] |
//!
//! Traffic is not encrypted: put a TLS proxy before it.

use http_body_util::{combinators::UnsyncBoxBody, BodyExt, Full, Limited, StreamBody};
use hyper::{
    body::{Bytes, Frame, Incoming},
    header::{HeaderValue, CACHE_CONTROL, CONTENT_LENGTH, CONTENT_TYPE},
    server::conn::http1,
    service::service_fn,
    Method, Request, Response, StatusCode,
};
use hyper_util::rt::{TokioIo, TokioTimer};
use std::{convert::Infallible, future::Future, io, path::PathBuf, sync::Arc, time::Duration};
use tokio::{
    io::AsyncReadExt,
    net::TcpListener,
    sync::{mpsc, Semaphore},
    task::{spawn_blocking, JoinSet},
    time::{sleep, timeout},
};
use tokio_stream::wrappers::ReceiverStream;

/// What a server puts up with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Connections at once; who comes later waits at the door.
    pub connections: usize,
    /// How long a client may take to say what it wants, or to take the next part of a file.
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

/// A request, read to its end.
#[derive(Clone, Debug)]
pub struct Call {
    /// GET, POST, …
    pub method: Method,
    /// The path, without the leading slash and without a query.
    pub path: String,
    /// The body.
    pub body: Bytes,
}

/// An answer.
#[derive(Clone, Debug)]
pub struct Reply {
    /// HTTP status.
    pub status: u16,
    /// Content type.
    pub kind: &'static str,
    /// What caches may do with it.
    pub cache: &'static str,
    /// The bytes.
    pub body: Body,
}

/// The bytes of an answer.
#[derive(Clone, Debug)]
pub enum Body {
    /// These.
    Bytes(Vec<u8>),
    /// Those of a file, in parts.
    File(PathBuf),
}

/// Never changes: keep it for a year.
pub const IMMUTABLE: &str = "public, max-age=31536000, immutable";

/// Changes: ask again each time.
pub const NO_CACHE: &str = "no-cache";

/// Plain text.
pub const TEXT: &str = "text/plain; charset=utf-8";

/// Bytes.
pub const BINARY: &str = "application/octet-stream";

impl Reply {
    /// A short text that must not be kept.
    pub fn text(status: u16, text: impl Into<String>) -> Self {
        Self {
            status,
            kind: TEXT,
            cache: NO_CACHE,
            body: Body::Bytes(text.into().into_bytes()),
        }
    }
}

/// Answers requests; called away from the threads that serve the network, so it may read and write files.
pub trait Handler: Send + Sync + 'static {
    /// Answers one.
    fn answer(&self, call: &Call) -> Reply;
}

/// Serves on `listener` until `stop` is ready.
pub async fn serve(
    listener: TcpListener,
    handler: Arc<dyn Handler>,
    limits: Limits,
    stop: impl Future<Output = ()>,
) {
    let places = Arc::new(Semaphore::new(limits.connections));
    let mut connections = JoinSet::new();
    tokio::pin!(stop);
    loop {
        while connections.try_join_next().is_some() {}
        let place = tokio::select! {
            () = &mut stop => break,
            place = places.clone().acquire_owned() => place,
        };
        let Ok(place) = place else { break };
        let accepted = tokio::select! {
            () = &mut stop => break,
            accepted = listener.accept() => accepted,
        };
        let Ok((stream, _)) = accepted else {
            // Out of file descriptors, most likely: it passes.
            sleep(Duration::from_millis(100)).await;
            continue;
        };
        let handler = handler.clone();
        connections.spawn(async move {
            let service = service_fn(move |request| {
                let handler = handler.clone();
                async move { Ok::<_, Infallible>(respond(request, handler, limits).await) }
            });
            let connection = http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(limits.silence)
                .max_buf_size(16 << 10)
                .serve_connection(TokioIo::new(stream), service);
            // A client that went away or took too long is no event.
            let _ = timeout(limits.lifetime, connection).await;
            drop(place);
        });
    }
    connections.shutdown().await;
}

type ResponseBody = UnsyncBoxBody<Bytes, io::Error>;

async fn respond(
    request: Request<Incoming>,
    handler: Arc<dyn Handler>,
    limits: Limits,
) -> Response<ResponseBody> {
    let (head, body) = request.into_parts();
    let body = timeout(limits.silence, Limited::new(body, limits.body).collect()).await;
    let reply = match body {
        Err(_) => Reply::text(408, "the request's body took too long\n"),
        Ok(Err(_)) => Reply::text(
            413,
            format!("the request's body has more than {} bytes\n", limits.body),
        ),
        Ok(Ok(body)) => {
            let path = head.uri.path();
            let call = Call {
                method: head.method,
                path: path.strip_prefix('/').unwrap_or(path).into(),
                body: body.to_bytes(),
            };
            spawn_blocking(move || handler.answer(&call))
                .await
                .unwrap_or_else(|_| Reply::text(500, "the server failed\n"))
        }
    };
    render(reply, limits.silence).await
}

async fn render(reply: Reply, silence: Duration) -> Response<ResponseBody> {
    let (length, body) = match reply.body {
        Body::Bytes(bytes) => (
            bytes.len() as u64,
            Full::new(Bytes::from(bytes))
                .map_err(|never| match never {})
                .boxed_unsync(),
        ),
        Body::File(path) => match file(&path, silence).await {
            Ok(opened) => opened,
            Err(error) => {
                tracing::error!("{}: {error}", path.display());
                return plain(500);
            }
        },
    };
    let mut response = Response::new(body);
    *response.status_mut() =
        StatusCode::from_u16(reply.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(reply.kind));
    headers.insert(CACHE_CONTROL, HeaderValue::from_static(reply.cache));
    headers.insert(CONTENT_LENGTH, length.into());
    response
}

fn plain(status: u16) -> Response<ResponseBody> {
    let empty = Full::new(Bytes::new()).map_err(|never| match never {});
    let mut response = Response::new(empty.boxed_unsync());
    *response.status_mut() =
        StatusCode::from_u16(status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    response
}

/// A file's length, and its bytes in parts: memory stays small whatever its size, and a reader that stalls is left.
async fn file(path: &std::path::Path, silence: Duration) -> io::Result<(u64, ResponseBody)> {
    let mut file = tokio::fs::File::open(path).await?;
    let length = file.metadata().await?.len();
    let (sender, parts) = mpsc::channel(2);
    tokio::spawn(async move {
        loop {
            let mut part = vec![0; 64 << 10];
            let frame = match file.read(&mut part).await {
                Ok(0) => return,
                Ok(read) => {
                    part.truncate(read);
                    Ok(Frame::data(Bytes::from(part)))
                }
                Err(error) => Err(error),
            };
            match timeout(silence, sender.send(frame)).await {
                Ok(Ok(())) => {}
                _ => return,
            }
        }
    });
    Ok((
        length,
        StreamBody::new(ReceiverStream::new(parts)).boxed_unsync(),
    ))
}
