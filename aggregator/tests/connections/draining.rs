//! The end of a server takes a bounded time, and loses nothing that was acknowledged.

use super::{registration, with};
use crate::Test;
use std::time::{Duration, Instant};
use tokio::net::TcpStream;
use tokio::sync::{mpsc, oneshot};
use tokio::time::{sleep, timeout};
use tokio_stream::wrappers::ReceiverStream;
use zk0_aggregator::{Aggregator, ConnectionLimits};
use zk0_protocol::entries::signed::Signed;
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::upload_chunk::Part;
use zk0_protocol::Body;
use zk0_testkit::aggregator::witnesses::three;
use zk0_testkit::aggregator::*;
use zk0_testkit::sockets::speaking;
use zk0_testkit::until_async;

#[tokio::test(flavor = "multi_thread")]
async fn a_peer_that_holds_a_stream_open_does_not_keep_the_server() -> Test {
    let drain = Duration::from_millis(300);
    let (mut network, [node, other]) = with(ConnectionLimits {
        drain,
        ..ConnectionLimits::default()
    })
    .await;
    node.register(&network).await?;
    network.settle().await;
    let request = node.upload_request(&network.genesis.network_id(), 0, &weights(1));
    let request = Signed::new(request, &node.key);
    let (sender, receiver) = mpsc::channel(4);
    let part = Some(Part::Request(borsh::to_vec(&request)?));
    sender.send(proto::UploadChunk { part, begins: 0 }).await?;
    let mut holder = network.client().await;
    let request = node.uploading(&network, &request, ReceiverStream::new(receiver));
    let holding = tokio::spawn(async move { holder.upload(request).await });
    // Another peer sends nothing, and takes nothing.
    let _silent = speaking([1, 1], &network.address).await;
    let mut client = network.client().await;
    let receipt = client.record(registration(&network, &other)).await?;
    let index = receipt.into_inner().index;
    network.in_progress("Upload", 1).await;

    let begun = Instant::now();
    network.stop().await;
    let took = begun.elapsed();
    // An upload may be silent for thirty seconds.
    assert!(took >= drain && took < SOON, "{took:?}");
    assert!(holding.await?.is_err());
    drop(sender);

    network.start_again().await;
    let entry = &network.entries().await[index as usize];
    assert!(matches!(entry.body, Body::DatasetCommitted(_)), "{entry:?}");
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_with_idle_connections_ends_at_once() -> Test {
    let (mut network, _) = with_a_long_drain().await;
    let mut client = network.client().await;
    client.get_network(proto::GetNetworkRequest {}).await?;
    let begun = Instant::now();
    network.stop().await;
    assert!(begun.elapsed() < SOON);
    assert!(client
        .get_network(proto::GetNetworkRequest {})
        .await
        .is_err());
    Ok(())
}

/// Far more than an end takes that waits for nobody, and far less than [`LONG_DRAIN`].
const SOON: Duration = Duration::from_secs(20);

/// So long that a server cuts nobody within the time of a test.
const LONG_DRAIN: Duration = Duration::from_secs(60);

/// A network whose requests have [`LONG_DRAIN`] to end.
async fn with_a_long_drain() -> (Network, [SigningNode; 2]) {
    with(ConnectionLimits {
        drain: LONG_DRAIN,
        ..ConnectionLimits::default()
    })
    .await
}

/// Tells the server to end while somebody has the aggregator. The rounds wait for it, and behind them two requests. Both have to be answered.
async fn end_with_requests_behind_the_rounds(network: &mut Network, node: &SigningNode) -> Test {
    let (has, holds) = oneshot::channel();
    let (let_go, held) = std::sync::mpsc::channel::<()>();
    let hold = move |_: &mut Aggregator| {
        let _ = has.send(());
        // This is ready when the other end is dropped.
        let _ = held.recv();
        Ok(())
    };
    // The connections are there before somebody has the aggregator: a busy machine may take long to accept them.
    let (mut first, mut second) = (network.client().await, network.client().await);
    for client in [&mut first, &mut second] {
        client.get_network(proto::GetNetworkRequest {}).await?;
    }
    let service = network.service().clone();
    let holding = tokio::spawn(async move { service.with(hold).await });
    holds.await?;
    // The rounds look four times a second whether something is due.
    sleep(Duration::from_millis(300)).await;
    let request = registration(network, node);
    let registering = tokio::spawn(async move { first.record(request).await });
    let asking = tokio::spawn(async move { second.get_network(proto::GetNetworkRequest {}).await });
    network.in_progress("Record", 1).await;
    network.in_progress("GetNetwork", 1).await;
    let address = network.address.replace("http://", "");
    let let_go = async move {
        let ends = async || TcpStream::connect(&address).await.is_err();
        until_async("the server takes no more connections", ends).await;
        drop(let_go);
    };
    timeout(SOON, async { tokio::join!(network.stop(), let_go) }).await?;
    holding.await??;
    asking.await??;
    registering.await??;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn requests_in_progress_are_answered_although_the_rounds_want_the_aggregator() -> Test {
    let (mut network, [node, _]) = with_a_long_drain().await;
    end_with_requests_behind_the_rounds(&mut network, &node).await
}

#[tokio::test(flavor = "multi_thread")]
async fn requests_in_progress_still_get_receipts_that_witnesses_have_cosigned() -> Test {
    let (mut network, [node, other]) = with_a_long_drain().await;
    let (_witnesses, policy) = three().await;
    network.policy = Some(policy);
    network.restart().await;
    // From now on something is published.
    other.register(&network).await?;
    end_with_requests_behind_the_rounds(&mut network, &node).await
}
