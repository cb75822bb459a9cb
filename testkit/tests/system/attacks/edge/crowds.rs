//! What the attacks of crowds share: a service with few places, and somebody new who asks it.

use std::time::Duration;
use tokio::time::timeout;
use zk0_aggregator::{Config, ConnectionLimits, Limits};
use zk0_protocol::rpc::federation::federation_client::FederationClient;
use zk0_protocol::rpc::federation::GetNetworkRequest;
use zk0_testkit::aggregator::{Network, SigningNode};

/// A network of this node, whose aggregator has `most` places for connections.
pub async fn with_places(node: &SigningNode, most: usize) -> Network {
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let limits = Limits {
        connections: ConnectionLimits {
            most,
            ..ConnectionLimits::default()
        },
        ..Limits::default()
    };
    Network::start_with(&[node], config, limits).await
}

/// Whether the aggregator at `url` answers somebody new within `patience`.
pub async fn is_answered(url: String, patience: Duration) -> bool {
    let asked = timeout(patience, async {
        let mut client = FederationClient::connect(url).await.ok()?;
        client.get_network(GetNetworkRequest {}).await.ok()
    });
    asked.await.ok().flatten().is_some()
}
