//! A node whose connection is lost in the middle of a request.

use crate::encrypted::Encrypted;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Arc;
use std::time::Duration;
use tokio::io::copy_bidirectional;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Notify;
use tokio::time::{sleep, timeout};

#[tokio::test(flavor = "multi_thread")]
async fn a_node_asks_again_when_its_connection_is_lost() {
    let mut served = Encrypted::serve(None).await;
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let relay = listener.local_addr().unwrap().to_string();
    let to = std::mem::replace(&mut served.address, relay);
    let (cut, connections) = (Arc::new(Notify::new()), Arc::new(AtomicUsize::new(0)));
    let (told, counted) = (cut.clone(), connections.clone());
    tokio::spawn(async move {
        while let Ok((mut node, _)) = listener.accept().await {
            counted.fetch_add(1, Ordering::SeqCst);
            let mut aggregator = TcpStream::connect(&to).await.unwrap();
            let told = told.clone();
            tokio::spawn(async move {
                tokio::select! {
                    _ = copy_bidirectional(&mut node, &mut aggregator) => {}
                    () = told.notified() => {}
                }
            });
        }
    });
    let mut node = served.connect("http", None).await.unwrap();
    let busy = served.busy_for(Duration::from_secs(1));
    let asking = tokio::spawn(async move { node.governance().await });
    sleep(Duration::from_millis(300)).await;
    cut.notify_waiters();
    let answer = timeout(Duration::from_secs(20), asking).await.unwrap();
    answer.unwrap().unwrap();
    busy.await.unwrap();
    assert_eq!(connections.load(Ordering::SeqCst), 2);
}
