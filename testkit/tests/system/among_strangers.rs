//! A node that has connected anew, while strangers hold all that they may share. The node has its own.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tokio::time::timeout;
use tonic::Code;
use zk0_aggregator::{Config, ConnectionLimits, Limits};
use zk0_node::client::NodeClient;
use zk0_node::client_error::NodeError;
use zk0_testkit::aggregator::{self, Network, LONG_BYTES, START_MS};
use zk0_testkit::sockets::{begin_large_message, from};

type Test = Result<(), Box<dyn std::error::Error>>;

/// A network of one node, and the node, which has asked for nothing but the network.
async fn network(limits: Limits) -> (Network, NodeClient) {
    let node = aggregator::SigningNode::new(1);
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let network = Network::start_with(&[&node], config, limits).await;
    // The node's clock is the system's.
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    network.clock.advance(now.as_millis() as u64 - START_MS);
    let id = network.genesis.network_id();
    let connected = NodeClient::connect(network.address.clone(), id, node.key).await;
    (network, connected.unwrap())
}

#[tokio::test(flavor = "multi_thread")]
async fn the_first_large_message_of_a_node_does_not_wait_for_those_of_strangers() -> Test {
    let (network, mut node) = network(Limits {
        // So there is room for one message of a stranger and for one of a node.
        message_memory: 0,
        message: Duration::from_secs(20),
        ..Limits::default()
    })
    .await;
    let mut slow = from([1, 1], &network.address).await;
    begin_large_message(&mut slow).await;
    network.large_message().await;
    let begun = Instant::now();
    let registration = aggregator::SigningNode::new(1)
        .registration(node.network())
        .statement;
    // The list is larger than a small message, and is not the one of the registration.
    let refused = node.register(registration, vec![0; 100_000]).await;
    assert!(
        matches!(&refused, Err(NodeError::Refused(status)) if status.code() == Code::InvalidArgument),
        "{refused:?}"
    );
    assert!(
        begun.elapsed() < Duration::from_secs(10),
        "{:?}",
        begun.elapsed()
    );
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn the_first_download_of_a_node_does_not_wait_for_those_of_strangers() -> Test {
    // So strangers have one download at once.
    let (network, mut node) = network(Limits {
        connections: ConnectionLimits {
            most: 8,
            ..ConnectionLimits::default()
        },
        ..Limits::default()
    })
    .await;
    let mut stranger = network.slow_reader().await;
    let request = network.long_download();
    let _held = stranger.download(request.clone()).await?;
    assert!(stranger.download(request).await.is_err());
    let mut bytes = Vec::new();
    let policy = network.genesis.policy;
    let downloading = node.download_to(&policy, LONG_BYTES, &mut bytes);
    let downloaded = timeout(Duration::from_secs(15), downloading).await?;
    // The file was made longer, so it has another digest.
    assert!(
        matches!(downloaded, Err(NodeError::OtherBlob { .. })),
        "{downloaded:?}"
    );
    assert_eq!(bytes.len() as u64, LONG_BYTES);
    Ok(())
}
