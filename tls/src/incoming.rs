//! Encrypted connections for a server that takes them one after the other, such as tonic's.

use crate::server_certificate::Acceptor;
use std::io;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};
use tokio_rustls::server::TlsStream;
use tokio_stream::wrappers::ReceiverStream;

/// How long a handshake may take.
const HANDSHAKE: Duration = Duration::from_secs(10);

/// Handshakes at once. Further connections are closed.
const HANDSHAKES: usize = 256;

/// The connections on `listener` whose handshake is done. Whoever is slow with it keeps nobody waiting. When the stream is dropped, nobody
/// listens any more.
pub fn encrypted(
    listener: TcpListener,
    acceptor: Acceptor,
) -> ReceiverStream<io::Result<TlsStream<TcpStream>>> {
    let (connected, connections) = mpsc::channel(1);
    tokio::spawn(async move {
        let mut handshakes = JoinSet::new();
        loop {
            while handshakes.try_join_next().is_some() {}
            let accepted = tokio::select! {
                () = connected.closed() => return,
                accepted = listener.accept() => accepted,
            };
            let stream = match accepted {
                Ok((stream, _)) => stream,
                Err(error) => {
                    // Most likely the process has no file descriptor left. Connections that end give some back.
                    tracing::warn!("a connection is refused: {error}");
                    sleep(Duration::from_millis(100)).await;
                    continue;
                }
            };
            if handshakes.len() >= HANDSHAKES {
                tracing::debug!("a connection is refused: {HANDSHAKES} handshakes are going on");
                continue;
            }
            let (acceptor, connected) = (acceptor.clone(), connected.clone());
            handshakes.spawn(async move {
                let _ = stream.set_nodelay(true);
                match timeout(HANDSHAKE, acceptor.accept(stream)).await {
                    Ok(Ok(stream)) => drop(connected.send(Ok(stream)).await),
                    // It is no event when a client goes away, takes too long, or does not speak TLS.
                    Ok(Err(error)) => tracing::debug!("a TLS handshake failed: {error}"),
                    Err(_) => tracing::debug!("a TLS handshake took more than {HANDSHAKE:?}"),
                }
            });
        }
    });
    ReceiverStream::new(connections)
}
