//! The end of a server takes a bounded time, and loses nothing that was acknowledged.

use crate::sockets::speaking;
use crate::{harness::*, registration, with, Test};
use std::time::{Duration, Instant};
use tokio::sync::mpsc;
use tokio::time::sleep;
use tokio_stream::wrappers::ReceiverStream;
use zk0_aggregator::ConnectionLimits;
use zk0_protocol::entries::signed::Signed;
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::upload_chunk::Part;
use zk0_protocol::Body;

#[tokio::test(flavor = "multi_thread")]
async fn a_peer_that_holds_a_stream_open_does_not_keep_the_server() -> Test {
    let drain = Duration::from_millis(800);
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
    let receipt = client
        .register_dataset(registration(&network, &other))
        .await?;
    let index = receipt.into_inner().index;
    sleep(Duration::from_millis(200)).await;

    let begun = Instant::now();
    network.stop().await;
    let took = begun.elapsed();
    assert!(
        took >= drain && took < drain + Duration::from_secs(1),
        "{took:?}"
    );
    assert!(holding.await?.is_err());
    drop(sender);

    network.start_again().await;
    let entry = &network.entries().await[index as usize];
    assert!(matches!(entry.body, Body::DatasetCommitted(_)), "{entry:?}");
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_with_idle_connections_ends_at_once() -> Test {
    let (mut network, _) = with(ConnectionLimits::default()).await;
    let mut client = network.client().await;
    client.get_network(proto::GetNetworkRequest {}).await?;
    let begun = Instant::now();
    network.stop().await;
    assert!(begun.elapsed() < Duration::from_secs(2));
    assert!(client
        .get_network(proto::GetNetworkRequest {})
        .await
        .is_err());
    Ok(())
}
