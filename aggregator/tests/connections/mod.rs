//! The servers on the network. Connections cannot be exhausted: silent, slow and greedy ones make room.

mod asked;
mod downloads;
mod draining;
mod encrypted_log;
mod evicting;
mod following;
mod idle;
mod log_files;
mod memory;
mod metrics;
mod relay;
mod silent;
mod starting;
mod waiting;

use zk0_aggregator::{Config, ConnectionLimits, Limits};
use zk0_protocol::rpc::federation as proto;
use zk0_testkit::aggregator::{Network, SigningNode};

/// A network of two nodes, of whom none has registered, with these limits.
async fn network(limits: Limits) -> (Network, [SigningNode; 2]) {
    let nodes = [SigningNode::new(1), SigningNode::new(2)];
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let network = Network::start_with(&[&nodes[0], &nodes[1]], config, limits).await;
    (network, nodes)
}

/// A network with these limits of connections.
async fn with(connections: ConnectionLimits) -> (Network, [SigningNode; 2]) {
    network(Limits {
        connections,
        ..Limits::default()
    })
    .await
}

fn registration(network: &Network, node: &SigningNode) -> tonic::Request<proto::RecordRequest> {
    let registration = node.registration(&network.genesis.network_id());
    node.registering(network, &registration, node.list())
}
