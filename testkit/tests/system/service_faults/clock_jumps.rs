//! A clock jumps by a day, forward or back: the aggregator's, or a node's. Nothing is recorded by a wrong clock, no round ends by it, and when
//! it is right again, everything goes on.

use super::{by_the_machines_clock, client, now_ms, DAY_MS};
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::Arc;
use std::time::Duration;
use tokio::time::timeout;
use tonic::Code;
use zk0_aggregator::round::request_error::RequestError;
use zk0_aggregator::Config;
use zk0_protocol::entries::entry::Body;
use zk0_service::tls::service_address::Silence;
use zk0_testkit::aggregator::{digest, open_round, refused, weights, Network, SigningNode};

const DAY: i64 = DAY_MS as i64;

/// No cut is expected here.
const PATIENT: Silence = Silence {
    asks_after: Duration::from_secs(30),
    lost_after: Duration::from_secs(30),
};

/// The deadline of the commitments of the open round.
async fn deadline(network: &Network) -> u64 {
    let deadline = network.service().with(|aggregator| {
        let round = aggregator.state().round().unwrap();
        Ok(round.opened.commit_deadline_ms)
    });
    deadline.await.unwrap()
}

async fn the_aggregators_clock_jumps_by(jump: i64) {
    let (network, first, second) = open_round().await;
    let (update, other) = (weights(1), weights(2));
    first.upload(&network, 0, &update).await.unwrap();
    first.commit(&network, 0, &update).await.unwrap();
    second.upload(&network, 0, &other).await.unwrap();
    let (before, deadline_before) = (network.entries().await, deadline(&network).await);

    network.clock.jump(jump);
    // The rounds do not go on, and the service does not end.
    for _ in 0..3 {
        let stopped = network.service().step().await.unwrap_err();
        let RequestError::Clock(why) = stopped else {
            panic!("{stopped}");
        };
        let words = if jump > 0 { "ahead" } else { "behind" };
        assert!(why.to_string().contains(words), "{why}");
    }
    // Nobody is told that they are late.
    let wrong = "the aggregator's clock is wrong";
    let committed = second.commit(&network, 0, &other).await;
    refused(committed, Code::Unavailable, wrong);
    refused(
        second.upload(&network, 0, &weights(3)).await,
        Code::Unavailable,
        wrong,
    );
    assert_eq!(network.entries().await, before);
    // What anybody may read is answered.
    let request = zk0_protocol::rpc::federation::GetNetworkRequest {};
    network.client().await.get_network(request).await.unwrap();

    network.clock.jump(-jump);
    second.commit(&network, 0, &other).await.unwrap();
    // All have committed, so the commitments close, long before their deadline.
    network.settle().await;
    let entries = network.entries().await;
    let (old, new) = entries.split_at(before.len());
    assert_eq!(old, before);
    assert!(matches!(new[0].body, Body::UpdateCommitted(_)), "{new:?}");
    assert!(matches!(new[1].body, Body::CommitmentsClosed(_)), "{new:?}");
    let latest = new.last().unwrap().time_ms;
    assert!(latest <= deadline_before, "{latest} {deadline_before}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_aggregators_clock_jumps_a_day_ahead_and_back() {
    the_aggregators_clock_jumps_by(DAY).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_aggregators_clock_jumps_a_day_back_and_ahead() {
    the_aggregators_clock_jumps_by(-DAY).await;
}

/// Each correction by a time service is small, and they do not add up to a jump.
#[tokio::test(flavor = "multi_thread")]
async fn small_steps_of_the_clock_are_no_jump() {
    let (network, first, _) = open_round().await;
    for _ in 0..10 {
        network.clock.advance(2 * 3_600_000);
        network.clock.jump(20_000);
        network.service().step().await.unwrap();
    }
    network.clock.jump(61_000);
    let stopped = network.service().step().await.unwrap_err();
    assert!(matches!(stopped, RequestError::Clock(_)), "{stopped}");
    let uploaded = first.upload(&network, 0, &weights(1)).await;
    refused(uploaded, Code::Unavailable, "clock is wrong");
}

async fn a_nodes_clock_jumps_by(jump: i64) {
    let node = SigningNode::new(1);
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let network = Network::start(&[&node], config).await;
    by_the_machines_clock(&network);
    node.register(&network).await.unwrap();
    network.settle().await;
    let ahead = Arc::new(AtomicI64::new(0));
    let shown = ahead.clone();
    let joined = client(&network, &node, &network.address, PATIENT).await;
    let mut joined =
        joined.by_clock(move || now_ms().saturating_add_signed(shown.load(Ordering::SeqCst)));
    let update = weights(1);
    joined.upload(0, update.clone()).await.unwrap();

    ahead.store(jump, Ordering::SeqCst);
    let root = node.dataset().root;
    let update = digest(&update);
    let mut committing = tokio::spawn(async move { joined.commit(0, &root, &update, 4).await });
    // The node asks again and again, and the aggregator records nothing.
    let before = network.entries().await.len();
    assert!(timeout(Duration::from_secs(3), &mut committing)
        .await
        .is_err());
    assert_eq!(network.entries().await.len(), before);
    // Its clock is set right, and it goes on by itself.
    ahead.store(0, Ordering::SeqCst);
    let committed = timeout(Duration::from_secs(20), committing).await;
    let (_, receipt) = committed.unwrap().unwrap().unwrap();
    assert_eq!(receipt.index as usize, before);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_nodes_clock_jumps_a_day_ahead() {
    a_nodes_clock_jumps_by(DAY).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_nodes_clock_jumps_a_day_back() {
    a_nodes_clock_jumps_by(-DAY).await;
}
