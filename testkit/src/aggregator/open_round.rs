//! An open round and its first steps.

use super::{genesis, weights, Network, SigningNode};
use zk0_aggregator::{Config, Limits};
use zk0_protocol::entries::genesis::Genesis;

/// Two nodes with datasets in round 0.
pub async fn open_round() -> (Network, SigningNode, SigningNode) {
    open_round_of(genesis()).await
}

/// [`open_round`] for this genesis.
pub async fn open_round_of(genesis: Genesis) -> (Network, SigningNode, SigningNode) {
    let (first, second) = (SigningNode::new(1), SigningNode::new(2));
    let config = Config {
        rounds: Some(2),
        min_nodes: 2,
    };
    let nodes = [&first, &second];
    let network = Network::start_as(&nodes, config, Limits::default(), genesis, None, None).await;
    first.register(&network).await.unwrap();
    second.register(&network).await.unwrap();
    network.settle().await;
    (network, first, second)
}

/// Uploads and commits update `seed`.
pub async fn committed(network: &Network, node: &SigningNode, round: u64, seed: u32) -> Vec<u8> {
    let update = weights(seed);
    node.upload(network, round, &update).await.unwrap();
    node.commit(network, round, &update).await.unwrap();
    update
}

/// Both commit. Returns the first update.
pub async fn both_committed(
    network: &Network,
    first: &SigningNode,
    second: &SigningNode,
) -> Vec<u8> {
    committed(network, second, 0, 2).await;
    committed(network, first, 0, 1).await
}
