//! A relay to the aggregator, which counts the connections of a client.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Arc;
use tokio::io::copy_bidirectional;
use tokio::net::{TcpListener, TcpStream};
use tonic::transport::Channel;
use zk0_protocol::rpc::federation::federation_client::FederationClient;

/// A client of the aggregator whose connections are counted.
pub struct Counted {
    pub client: FederationClient<Channel>,
    connections: Arc<AtomicUsize>,
}

impl Counted {
    /// Connects to the aggregator at `url`.
    pub async fn connect(url: &str) -> Self {
        let to = url.strip_prefix("http://").unwrap().to_owned();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let connections = Arc::new(AtomicUsize::new(0));
        let count = connections.clone();
        tokio::spawn(async move {
            while let Ok((mut client, _)) = listener.accept().await {
                count.fetch_add(1, Ordering::SeqCst);
                let to = to.clone();
                tokio::spawn(async move {
                    let mut server = TcpStream::connect(to).await.unwrap();
                    let _ = copy_bidirectional(&mut client, &mut server).await;
                });
            }
        });
        Self {
            client: FederationClient::connect(url).await.unwrap(),
            connections,
        }
    }

    /// How often the client has connected.
    pub fn connections(&self) -> usize {
        self.connections.load(Ordering::SeqCst)
    }
}
