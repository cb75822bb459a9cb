//! The connections of a server that takes them one after the other and speaks HTTP/2, such as tonic's: encrypted or not, bounded in number,
//! closed if silent at first.

use crate::tls::server_certificate::Acceptor;
use std::future::Future;
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpListener;
use tokio::sync::{mpsc, OwnedSemaphorePermit, Semaphore};
use tokio::task::JoinSet;
use tokio::time::{sleep, sleep_until, timeout_at, Instant, Sleep};
use tokio_stream::wrappers::ReceiverStream;

/// The first bytes of an HTTP/2 client. After them, the server checks whether the client is still there.
const PREFACE_BYTES: usize = 24;

/// How often the log repeats that connections wait or are refused.
const SAY_AGAIN: Duration = Duration::from_secs(60);

/// A server's limits for connections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bounds {
    /// Connections at once; others wait.
    pub most: usize,
    /// Time limit of TLS handshake and first HTTP/2 bytes together.
    pub begin: Duration,
}

impl Default for Bounds {
    fn default() -> Self {
        Self {
            most: 256,
            begin: Duration::from_secs(10),
        }
    }
}

/// The connections on `listener`, encrypted if there is an acceptor. While places are free, a slow handshake delays no other. Dropping the
/// stream closes the listener.
pub fn connections(
    listener: TcpListener,
    tls: Option<Acceptor>,
    bounds: Bounds,
) -> ReceiverStream<io::Result<Connection>> {
    let (connected, connections) = mpsc::channel(1);
    tokio::spawn(async move {
        let places = Arc::new(Semaphore::new(bounds.most.max(1)));
        let (mut handshakes, mut reported) = (JoinSet::new(), None);
        loop {
            while handshakes.try_join_next().is_some() {}
            if places.available_permits() == 0 {
                let most = bounds.most;
                let why = format!("all {most} connections are taken: others wait until one ends");
                warn(&mut reported, &why);
            }
            // Meanwhile clients wait in the system's queue, without a file descriptor.
            let accepted = async {
                let place = places.clone().acquire_owned().await;
                let place = place.map_err(io::Error::other)?;
                Ok::<_, io::Error>((listener.accept().await?.0, place))
            };
            let accepted = tokio::select! {
                () = connected.closed() => return,
                accepted = accepted => accepted,
            };
            let (stream, place) = match accepted {
                Ok(accepted) => accepted,
                Err(error) => {
                    // Probably no file descriptor is left; connections that end free some.
                    warn(&mut reported, &format!("a connection is refused: {error}"));
                    sleep(Duration::from_millis(100)).await;
                    continue;
                }
            };
            let (tls, connected) = (tls.clone(), connected.clone());
            let due = Instant::now() + bounds.begin;
            handshakes.spawn(async move {
                let _ = stream.set_nodelay(true);
                let stream: Box<dyn ByteStream> = match tls {
                    None => Box::new(stream),
                    Some(tls) => match timeout_at(due, tls.accept(stream)).await {
                        Ok(Ok(stream)) => Box::new(stream),
                        // Clients that leave, are too slow or do not speak TLS are not worth a warning.
                        Ok(Err(error)) => {
                            return tracing::debug!("a TLS handshake failed: {error}")
                        }
                        Err(_) => return tracing::debug!("a TLS handshake took too long"),
                    },
                };
                let connection = Connection {
                    stream,
                    beginning: Some(Beginning {
                        come: 0,
                        due: Box::pin(sleep_until(due)),
                    }),
                    _place: place,
                };
                drop(connected.send(Ok(connection)).await);
            });
        }
    });
    ReceiverStream::new(connections)
}

/// Logs it, unless something was logged a moment ago.
fn warn(reported: &mut Option<Instant>, why: &str) {
    if reported.is_none_or(|at| at.elapsed() >= SAY_AGAIN) {
        tracing::warn!("{why}");
        *reported = Some(Instant::now());
    }
}

/// Bytes in both directions.
trait ByteStream: AsyncRead + AsyncWrite + Send + Sync + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Sync + Unpin> ByteStream for T {}

/// A connection, which keeps its place until dropped.
pub struct Connection {
    stream: Box<dyn ByteStream>,
    /// Until the client speaks HTTP/2.
    beginning: Option<Beginning>,
    _place: OwnedSemaphorePermit,
}

/// A connection's first bytes.
struct Beginning {
    come: usize,
    due: Pin<Box<Sleep>>,
}

impl AsyncRead for Connection {
    fn poll_read(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        let before = buffer.filled().len();
        let polled = Pin::new(&mut this.stream).poll_read(context, buffer);
        let Some(beginning) = &mut this.beginning else {
            return polled;
        };
        // Reads first: a busy server may look late at bytes that came in time.
        beginning.come += buffer.filled().len() - before;
        if beginning.come >= PREFACE_BYTES {
            this.beginning = None;
        } else if beginning.due.as_mut().poll(context).is_ready() {
            return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
        }
        polled
    }
}

impl AsyncWrite for Connection {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(feature = "grpc")]
impl tonic::transport::server::Connected for Connection {
    type ConnectInfo = ();

    fn connect_info(&self) {}
}
