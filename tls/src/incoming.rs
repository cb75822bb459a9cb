//! The connections of a server that takes them one after the other and speaks HTTP/2, such as tonic's: encrypted or not, a bounded number at a
//! time, and none on which nothing is said.

use crate::server_certificate::Acceptor;
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

/// A client of HTTP/2 begins with so many bytes. As soon as they are there, the server asks by itself whether the client is still there.
const PREFACE_BYTES: usize = 24;

/// How often the log says that connections wait or are refused.
const SAY_AGAIN: Duration = Duration::from_secs(60);

/// What a server allows its connections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bounds {
    /// Connections at once. Others wait until one of them ends.
    pub most: usize,
    /// How long the TLS handshake and the first bytes of HTTP/2 may take together.
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

/// The connections on `listener`, encrypted if there is an acceptor. Whoever is slow with the handshake keeps nobody waiting while there are
/// places. When the stream is dropped, nobody listens any more.
pub fn connections(
    listener: TcpListener,
    tls: Option<Acceptor>,
    bounds: Bounds,
) -> ReceiverStream<io::Result<Connection>> {
    let (connected, connections) = mpsc::channel(1);
    tokio::spawn(async move {
        let places = Arc::new(Semaphore::new(bounds.most.max(1)));
        let (mut handshakes, mut said) = (JoinSet::new(), None);
        loop {
            while handshakes.try_join_next().is_some() {}
            if places.available_permits() == 0 {
                let most = bounds.most;
                let why = format!("all {most} connections are taken: others wait until one ends");
                warn(&mut said, &why);
            }
            // Whoever comes meanwhile waits in the system's queue, where it costs no file descriptor.
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
                    // Most likely the process has no file descriptor left. Connections that end give some back.
                    warn(&mut said, &format!("a connection is refused: {error}"));
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
                        // It is no event when a client goes away, takes too long, or does not speak TLS.
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

/// Writes it to the log, unless something was written a moment ago.
fn warn(said: &mut Option<Instant>, why: &str) {
    if said.is_none_or(|at| at.elapsed() >= SAY_AGAIN) {
        tracing::warn!("{why}");
        *said = Some(Instant::now());
    }
}

/// Bytes in both directions.
trait ByteStream: AsyncRead + AsyncWrite + Send + Sync + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Sync + Unpin> ByteStream for T {}

/// A connection. It has its place until it is dropped.
pub struct Connection {
    stream: Box<dyn ByteStream>,
    /// Until the client has begun to speak HTTP/2.
    beginning: Option<Beginning>,
    _place: OwnedSemaphorePermit,
}

/// The first bytes of a connection.
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
        // A server that was busy may look late at bytes that came in time. So it reads first.
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
