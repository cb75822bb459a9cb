//! A node whose connection is lost in the middle of a request.

use super::encrypted::Encrypted;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{mpsc, Arc};
use tokio::io::{copy_bidirectional, AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Notify;
use zk0_testkit::until_async;

/// Passes the bytes of nodes on to an aggregator, and can cut the connection.
#[derive(Default)]
struct Relay {
    connections: AtomicUsize,
    /// A connection waits for the next byte of the node, which begins a request, and ends.
    cut: Notify,
}

impl Relay {
    async fn serve(self: Arc<Self>, listener: TcpListener, to: String) {
        while let Ok((node, _)) = listener.accept().await {
            self.connections.fetch_add(1, Ordering::SeqCst);
            let aggregator = TcpStream::connect(&to).await.unwrap();
            tokio::spawn(self.clone().pass(node, aggregator));
        }
    }

    async fn pass(self: Arc<Self>, mut node: TcpStream, mut aggregator: TcpStream) {
        tokio::select! {
            _ = copy_bidirectional(&mut node, &mut aggregator) => return,
            () = self.cut.notified() => {}
        }
        let mut request = [0; 1024];
        let read = node.read(&mut request).await.unwrap();
        aggregator.write_all(&request[..read]).await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_asks_again_when_its_connection_is_lost() {
    let mut served = Encrypted::serve(None).await;
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let to = std::mem::replace(&mut served.address, address);
    let relay = Arc::new(Relay::default());
    tokio::spawn(relay.clone().serve(listener, to));
    let mut node = served.connect("http", None).await.unwrap();
    let (release, released) = mpsc::channel();
    let busy = served.busy_until(released);
    relay.cut.notify_one();
    let asking = tokio::spawn(async move { node.governance().await });
    // The aggregator answers nobody before the node has asked again.
    let again = async || relay.connections.load(Ordering::SeqCst) == 2;
    until_async("the node connects again", again).await;
    release.send(()).unwrap();
    asking.await.unwrap().unwrap();
    busy.await.unwrap();
    assert_eq!(relay.connections.load(Ordering::SeqCst), 2);
}
