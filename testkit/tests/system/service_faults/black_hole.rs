//! A relay that can lose all that is sent, and closes no connection: to both sides, a cut network looks like silence.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::Arc;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};

/// A relay to an aggregator.
pub struct BlackHole {
    pub url: String,
    state: Arc<State>,
}

#[derive(Default)]
struct State {
    to_server: Direction,
    to_client: Direction,
    /// How many bytes come through yet, if that is bounded.
    left: AtomicUsize,
    bounded: AtomicBool,
    connections: AtomicUsize,
}

/// What becomes of the bytes that go in one direction.
#[derive(Default)]
struct Direction {
    losing: AtomicBool,
    lost_bytes: AtomicUsize,
}

impl BlackHole {
    /// Relays to the server at `url`.
    pub async fn before(url: &str) -> Self {
        let to = url.strip_prefix("http://").unwrap().to_owned();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let state = Arc::new(State::default());
        let shared = state.clone();
        tokio::spawn(async move {
            while let Ok((client, _)) = listener.accept().await {
                let (to, state) = (to.clone(), shared.clone());
                state.connections.fetch_add(1, Ordering::SeqCst);
                tokio::spawn(async move {
                    let server = TcpStream::connect(to).await.unwrap();
                    let (client, server) = (client.into_split(), server.into_split());
                    tokio::join!(
                        relay(client.0, server.1, &state, &state.to_server),
                        relay(server.0, client.1, &state, &state.to_client),
                    );
                });
            }
        });
        Self { url, state }
    }

    /// From now on, nothing comes through in either direction.
    pub fn cut(&self) {
        self.lose_answers();
        self.state.to_server.loses(true);
    }

    /// When so many bytes have come, nothing comes through any more.
    pub fn cut_after(&self, bytes: usize) {
        self.state.left.store(bytes, Ordering::SeqCst);
        self.state.bounded.store(true, Ordering::SeqCst);
    }

    /// From now on, nothing comes through to the client.
    pub fn lose_answers(&self) {
        self.state.to_client.loses(true);
    }

    /// From now on, new connections work. Those that have lost something stay silent.
    pub fn heal(&self) {
        self.state.to_server.loses(false);
        self.state.to_client.loses(false);
        self.state.bounded.store(false, Ordering::SeqCst);
    }

    /// How many connections there were.
    pub fn connections(&self) -> usize {
        self.state.connections.load(Ordering::SeqCst)
    }

    /// How many bytes were lost on their way to the server, and to the client.
    pub fn lost_bytes(&self) -> [usize; 2] {
        [&self.state.to_server, &self.state.to_client]
            .map(|direction| direction.lost_bytes.load(Ordering::SeqCst))
    }
}

impl Direction {
    fn loses(&self, losing: bool) {
        self.losing.store(losing, Ordering::SeqCst);
    }
}

impl State {
    /// These bytes come.
    fn count(&self, bytes: usize) {
        let left = |left: usize| Some(left.saturating_sub(bytes));
        let before = self
            .left
            .fetch_update(Ordering::SeqCst, Ordering::SeqCst, left);
        if self.bounded.load(Ordering::SeqCst) && before.is_ok_and(|left| left <= bytes) {
            self.to_server.loses(true);
            self.to_client.loses(true);
        }
    }
}

/// Relays until something is lost. From then on, everything is. The end of a connection is lost, too.
async fn relay(
    mut from: OwnedReadHalf,
    mut to: OwnedWriteHalf,
    state: &State,
    direction: &Direction,
) {
    let mut buffer = [0; 4096];
    let mut lost = false;
    while let Ok(read @ 1..) = from.read(&mut buffer).await {
        state.count(read);
        lost |= direction.losing.load(Ordering::SeqCst);
        if lost {
            direction.lost_bytes.fetch_add(read, Ordering::SeqCst);
        } else if to.write_all(&buffer[..read]).await.is_err() {
            return;
        }
    }
    if lost || direction.losing.load(Ordering::SeqCst) {
        std::future::pending::<()>().await;
    }
}
