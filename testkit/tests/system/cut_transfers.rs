//! A node's uploads and downloads through connections that are cut again and again.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::sleep;
use zk0_aggregator::Config;
use zk0_node::client::NodeClient;
use zk0_protocol::Signed;
use zk0_testkit::aggregator::{self, Network, POLICY, START_MS};
use zk0_verifier::blob_digest;

type Test = Result<(), Box<dyn std::error::Error>>;

/// A relay to the aggregator, which cuts each connection after so many bytes in one direction.
struct Cutting {
    url: String,
    relayed: Arc<AtomicU64>,
    cuts: Arc<AtomicU64>,
}

impl Cutting {
    async fn after(bytes: u64, network: &Network) -> Self {
        let to = network.address.strip_prefix("http://").unwrap().to_owned();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let (relayed, cuts) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
        let counted = (relayed.clone(), cuts.clone());
        tokio::spawn(async move {
            while let Ok((client, _)) = listener.accept().await {
                let (to, (relayed, cuts)) = (to.clone(), counted.clone());
                tokio::spawn(async move {
                    let server = TcpStream::connect(to).await.unwrap();
                    let (client, server) = (client.into_split(), server.into_split());
                    tokio::join!(
                        relay(client.0, server.1, bytes, &relayed, &cuts),
                        relay(server.0, client.1, bytes, &relayed, &cuts),
                    );
                });
            }
        });
        Self { url, relayed, cuts }
    }
}

/// Relays at most so many bytes, and ends the connection then. Its receiver still reads what was relayed.
async fn relay(
    mut from: OwnedReadHalf,
    mut to: OwnedWriteHalf,
    bytes: u64,
    relayed: &AtomicU64,
    cuts: &AtomicU64,
) {
    let mut left = bytes;
    let mut buffer = [0; 4096];
    while left > 0 {
        let Ok(read @ 1..) = from.read(&mut buffer).await else {
            break;
        };
        let passed = (read as u64).min(left);
        if to.write_all(&buffer[..passed as usize]).await.is_err() {
            break;
        }
        relayed.fetch_add(passed, Ordering::SeqCst);
        left -= passed;
        // A connection whose whole life is over in a moment is no connection to a server: it reads the end before it has answered anything.
        sleep(Duration::from_millis(5)).await;
    }
    cuts.fetch_add(u64::from(left == 0), Ordering::SeqCst);
    let _ = to.shutdown().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn cut_transfers_go_on_and_send_next_to_nothing_twice() -> Test {
    let first = aggregator::SigningNode::new(1);
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let network = Network::start(&[&first], config).await;
    // The node's clock is the system's.
    let now = SystemTime::now().duration_since(UNIX_EPOCH)?;
    network.clock.advance(now.as_millis() as u64 - START_MS);
    first.register(&network).await?;
    network.settle().await;
    // Each connection carries less than half of it.
    let relay = Cutting::after(90_000, &network).await;
    let id = network.genesis.network_id();
    let mut node = NodeClient::connect(relay.url.clone(), id, first.key.clone()).await?;

    let limit = POLICY.len() as u64;
    let policy = node.download(&blob_digest(POLICY), limit).await?;
    assert_eq!(policy, POLICY);
    let cuts = relay.cuts.load(Ordering::SeqCst);
    assert!(cuts >= 2, "the download was cut {cuts} times");

    let update: Vec<u8> = (0..limit).map(|at| (at % 241) as u8).collect();
    node.upload(0, update.clone()).await?;
    let cuts = relay.cuts.load(Ordering::SeqCst) - cuts;
    assert!(cuts >= 2, "the upload was cut {cuts} times");
    let request = first.upload_request(&id, 0, &update);
    let request = Signed::new(request, &first.key);
    assert_eq!(first.held(&network, &request).await?, limit);

    let sent = relay.relayed.load(Ordering::SeqCst);
    assert!(sent < 2 * limit * 5 / 3, "{sent} bytes in all");
    Ok(())
}
