//! The memory for large messages is bounded, and strangers cannot take what is for nodes.

use crate::relay::Counted;
use crate::sockets::{begin_large_message, from};
use crate::{network, registration, Test};
use std::net::IpAddr;
use std::time::{Duration, Instant};
use tokio::time::sleep;
use tonic::transport::Endpoint;
use tonic::Code;
use zk0_aggregator::{Aggregator, Limits};
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::federation_client::FederationClient;

/// A large message that the aggregator refuses after it has read it.
fn large() -> proto::CommitRequest {
    proto::CommitRequest {
        commitment: vec![0; 3 << 20],
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn strangers_wait_for_memory_and_nodes_do_not() -> Test {
    let (network, [node, _]) = network(Limits {
        // So there is room for one message of a stranger and for one of a node.
        message_memory: 0,
        message: Duration::from_secs(2),
        ..Limits::default()
    })
    .await;
    let mut member = Counted::connect(&network.address).await;
    let request = registration(&network, &node);
    member.client.register_dataset(request).await?;
    let begun = Instant::now();
    let mut slow = from([1, 1], &network.address).await;
    begin_large_message(&mut slow).await;
    sleep(Duration::from_millis(200)).await;
    // Small requests, and large ones of nodes, are answered meanwhile.
    let mut stranger = network.client().await;
    stranger.get_network(proto::GetNetworkRequest {}).await?;
    let refused = member.client.commit(large()).await.unwrap_err();
    assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
    assert!(begun.elapsed() < Duration::from_secs(1));
    // A stranger's large message waits until the slow one is cut.
    let refused = stranger.commit(large()).await.unwrap_err();
    assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
    assert!(begun.elapsed() > Duration::from_millis(1500));
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn who_waits_for_memory_for_too_long_is_told_to_come_again() -> Test {
    let (network, [node, _]) = network(Limits {
        message_memory: 0,
        message: Duration::from_secs(3),
        ..Limits::default()
    })
    .await;
    // The aggregator is busy, so a large message keeps its memory although it has arrived.
    let service = network.service().clone();
    let (end, ended) = std::sync::mpsc::channel::<()>();
    let busy = tokio::spawn(async move {
        let work = move |_: &mut Aggregator| {
            let _ = ended.recv();
            Ok(())
        };
        service.with(work).await
    });
    let mut first = network.client().await;
    let mut request = registration(&network, &node);
    request.get_mut().leaves = vec![0; 3 << 20];
    let waiting = tokio::spawn(async move { first.register_dataset(request).await });
    sleep(Duration::from_secs(1)).await;
    let status = network.client().await.commit(large()).await.unwrap_err();
    assert_eq!(status.code(), Code::Unavailable, "{status}");
    assert!(status.message().contains("again later"), "{status}");
    drop(end);
    let status = waiting.await?.unwrap_err();
    assert_eq!(status.code(), Code::InvalidArgument, "{status}");
    busy.await??;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn an_address_sends_one_large_message_at_a_time() -> Test {
    let (network, _) = network(Limits {
        message: Duration::from_millis(1500),
        ..Limits::default()
    })
    .await;
    let begun = Instant::now();
    let mut slow = from([1, 1], &network.address).await;
    begin_large_message(&mut slow).await;
    sleep(Duration::from_millis(200)).await;
    let mut took = Vec::new();
    for host in [2, 1] {
        let endpoint = Endpoint::try_from(network.address.clone())?;
        let local = IpAddr::from([127, 0, 1, host]);
        let channel = endpoint.local_address(Some(local)).connect().await?;
        let mut client = FederationClient::new(channel);
        let refused = client.commit(large()).await.unwrap_err();
        assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
        took.push(begun.elapsed());
    }
    let first = Duration::from_millis(1000);
    assert!(took[0] < first && took[1] > first, "{took:?}");
    Ok(())
}
