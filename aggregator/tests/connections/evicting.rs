//! Who makes room when all places are taken.

use super::relay::Counted;
use super::{registration, with};
use crate::Test;
use std::time::Duration;
use tonic::Code;
use zk0_aggregator::ConnectionLimits;
use zk0_protocol::rpc::federation as proto;
use zk0_testkit::sockets::{closed, closes, speaking};

#[tokio::test(flavor = "multi_thread")]
async fn an_address_has_a_bounded_number_of_connections() -> Test {
    let (network, _) = with(ConnectionLimits {
        per_address: 3,
        ..ConnectionLimits::default()
    })
    .await;
    let mut elsewhere = speaking([2, 1], &network.address).await;
    let mut streams = Vec::new();
    for _ in 0..5 {
        streams.push(speaking([1, 1], &network.address).await);
    }
    let mut ended = Vec::new();
    for stream in &mut streams {
        ended.push(closed(stream).await);
    }
    assert_eq!(ended, [true, true, false, false, false]);
    assert!(!closed(&mut elsewhere).await);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn nodes_keep_their_places_and_the_idlest_strangers_go() -> Test {
    let (network, [node, _]) = with(ConnectionLimits {
        most: 4,
        ..ConnectionLimits::default()
    })
    .await;
    let mut member = Counted::connect(&network.address).await;
    let request = registration(&network, &node);
    member.client.record(request).await?;
    // The member is idle for longer than all strangers.
    let mut strangers = Vec::new();
    for host in 1..=10 {
        strangers.push(speaking([1, host], &network.address).await);
    }
    let mut ended = Vec::new();
    for stream in &mut strangers {
        ended.push(closed(stream).await);
    }
    assert_eq!(ended, (0..10).map(|at| at < 7).collect::<Vec<_>>());
    member
        .client
        .get_network(proto::GetNetworkRequest {})
        .await?;
    assert_eq!(member.connections(), 1);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_request_that_somebody_else_has_sent_gives_nobody_a_place() -> Test {
    let (network, [node, _]) = with(ConnectionLimits {
        most: 4,
        ..ConnectionLimits::default()
    })
    .await;
    let head = registration(&network, &node).metadata().clone();
    let seen = || {
        let mut request = registration(&network, &node);
        *request.metadata_mut() = head.clone();
        request
    };
    network.client().await.record(seen()).await?;
    // Somebody has read the request on its way, and sends it again.
    let mut thief = Counted::connect(&network.address).await;
    let refused = thief.client.record(seen()).await.unwrap_err();
    assert_eq!(refused.code(), Code::AlreadyExists, "{refused}");
    let mut streams = Vec::new();
    for host in 1..=4 {
        streams.push(speaking([1, host], &network.address).await);
    }
    thief.ends(1).await;
    thief.asks().await;
    assert_eq!(thief.connections(), 2);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_place_is_free_when_its_connection_ends() -> Test {
    let (network, _) = with(ConnectionLimits {
        most: 1,
        ..ConnectionLimits::default()
    })
    .await;
    for host in 1..=5 {
        let mut stream = speaking([1, host], &network.address).await;
        assert!(!closes(&mut stream, Duration::from_millis(50)).await);
    }
    network
        .client()
        .await
        .get_network(proto::GetNetworkRequest {})
        .await?;
    Ok(())
}
