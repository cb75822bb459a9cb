//! A relay to the aggregator, which counts the connections of a client.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Arc;
use std::time::Duration;
use tokio::io::copy_bidirectional;
use tokio::net::{TcpListener, TcpStream};
use tokio::time::timeout;
use tonic::transport::Channel;
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::federation_client::FederationClient;
use zk0_testkit::until_async;

/// A client of the aggregator whose connections are counted.
pub struct Counted {
    pub client: FederationClient<Channel>,
    connections: Arc<AtomicUsize>,
    ended: Arc<AtomicUsize>,
}

impl Counted {
    /// Connects to the aggregator at `url`.
    pub async fn connect(url: &str) -> Self {
        let to = url.strip_prefix("http://").unwrap().to_owned();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let (connections, ended) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
        let counts = (connections.clone(), ended.clone());
        tokio::spawn(async move {
            while let Ok((mut client, _)) = listener.accept().await {
                counts.0.fetch_add(1, Ordering::SeqCst);
                let (to, ended) = (to.clone(), counts.1.clone());
                tokio::spawn(async move {
                    let mut server = TcpStream::connect(to).await.unwrap();
                    let _ = copy_bidirectional(&mut client, &mut server).await;
                    ended.fetch_add(1, Ordering::SeqCst);
                });
            }
        });
        Self {
            client: FederationClient::connect(url).await.unwrap(),
            connections,
            ended,
        }
    }

    /// Waits until so many of its connections have ended, for less than the half minute after which a server without other limits ends them.
    pub async fn ends(&self, connections: usize) {
        let ended = async || self.ended.load(Ordering::SeqCst) == connections;
        let ends = until_async("a connection ends", ended);
        timeout(Duration::from_secs(20), ends).await.unwrap();
    }

    /// Asks for the network. A request that meets the end of its connection is sent again.
    pub async fn asks(&self) {
        let request = proto::GetNetworkRequest {};
        let answered = async || self.client.clone().get_network(request).await.is_ok();
        until_async("an answer", answered).await;
    }

    /// How often the client has connected.
    pub fn connections(&self) -> usize {
        self.connections.load(Ordering::SeqCst)
    }
}
