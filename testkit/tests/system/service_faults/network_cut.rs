//! The network between a node and its aggregator is cut for a while. Nothing tells either of them.

use super::black_hole::BlackHole;
use super::{by_the_machines_clock, client};
use std::time::Duration;
use tokio::time::timeout;
use zk0_aggregator::Config;
use zk0_protocol::entries::entry::Body;
use zk0_service::tls::service_address::Silence;
use zk0_testkit::aggregator::{digest, weights, Network, SigningNode};
use zk0_testkit::until_async;

/// How soon the node notices here. By default it takes a minute.
const SOON: Silence = Silence {
    asks_after: Duration::from_millis(300),
    lost_after: Duration::from_millis(300),
};

/// Longer than this, nothing may take after the cut.
const PATIENCE: Duration = Duration::from_secs(20);

/// A network with a node that has a dataset, and a relay before its aggregator.
async fn relayed() -> (Network, SigningNode, BlackHole) {
    let node = SigningNode::new(1);
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let network = Network::start(&[&node], config).await;
    by_the_machines_clock(&network);
    let hole = BlackHole::before(&network.address).await;
    (network, node, hole)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_that_waits_for_a_round_learns_of_it_after_the_cut() {
    let (network, node, hole) = relayed().await;
    let mut waiting = client(&network, &node, &hole.url, SOON).await;
    let waiting = tokio::spawn(async move { waiting.wait_for_round(0).await.map(drop) });
    network.in_progress("WatchRound", 1).await;
    hole.cut();
    // The round opens meanwhile, and the node is not told.
    node.register(&network).await.unwrap();
    network.settle().await;
    let not_told = async || hole.lost_bytes()[1] > 0;
    until_async("the aggregator's answer is lost", not_told).await;
    assert!(!waiting.is_finished());
    hole.heal();
    let told = timeout(PATIENCE, waiting).await;
    told.expect("the node waits for ever").unwrap().unwrap();
    assert!(hole.connections() >= 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_that_is_cut_goes_on_where_it_was() {
    let (network, node, hole) = relayed().await;
    node.register(&network).await.unwrap();
    network.settle().await;
    let mut sending = client(&network, &node, &hole.url, SOON).await;
    let size = network.genesis.rules.max_update_bytes;
    let update: Vec<u8> = (0..size).map(|at| (at % 241) as u8).collect();
    hole.cut_after(update.len() / 2);
    let cut = async {
        until_async("a part is lost", async || hole.lost_bytes()[0] > 0).await;
        hole.heal();
    };
    let sent = async { timeout(PATIENCE, sending.upload(0, update.clone())).await };
    let ((), sent) = tokio::join!(cut, sent);
    sent.expect("the node waits for ever").unwrap();
    let id = network.genesis.network_id();
    let request = node.upload_request(&id, 0, &update);
    let request = zk0_protocol::Signed::new(request, &node.key);
    let held = node.held(&network, &request).await.unwrap();
    assert_eq!(held, size);
    assert!(hole.connections() >= 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_commitment_whose_answer_is_lost_is_recorded_once() {
    let (network, node, hole) = relayed().await;
    node.register(&network).await.unwrap();
    network.settle().await;
    let mut committing = client(&network, &node, &hole.url, SOON).await;
    let update = weights(1);
    committing.upload(0, update.clone()).await.unwrap();
    let root = node.dataset().root;
    hole.lose_answers();
    let heal = async {
        until_async("an answer is lost", async || hole.lost_bytes()[1] > 0).await;
        hole.heal();
    };
    let committed = async {
        let update = digest(&update);
        let committed = committing.commit(0, &root, &update, 4);
        timeout(PATIENCE, committed).await
    };
    let ((), committed) = tokio::join!(heal, committed);
    let (_, receipt) = committed.expect("the node waits for ever").unwrap();
    let entries = network.entries().await;
    let recorded: Vec<_> = entries
        .iter()
        .enumerate()
        .filter(|(_, entry)| matches!(entry.body, Body::UpdateCommitted(_)))
        .map(|(index, _)| index as u64)
        .collect();
    assert_eq!(recorded, [receipt.index]);
}
