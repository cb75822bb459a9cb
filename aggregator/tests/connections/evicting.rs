//! Who makes room when all places are taken.

use super::relay::Counted;
use super::{registration, with};
use crate::Test;
use std::time::Duration;
use zk0_aggregator::ConnectionLimits;
use zk0_protocol::rpc::federation as proto;
use zk0_testkit::sockets::{closed, closes, speaking};

#[tokio::test(flavor = "multi_thread")]
async fn a_node_whose_connection_has_made_room_connects_again_by_itself() -> Test {
    let (network, [node, _]) = with(ConnectionLimits {
        most: 4,
        ..ConnectionLimits::default()
    })
    .await;
    let mut member = Counted::connect(&network.address).await;
    let request = registration(&network, &node);
    member.client.record(request).await?;
    // The member is idle for longer than all others.
    let mut others = Vec::new();
    for host in 1..=10 {
        others.push(speaking([1, host], &network.address).await);
    }
    let mut ended = Vec::new();
    for stream in &mut others {
        ended.push(closed(stream).await);
    }
    assert_eq!(ended, (0..10).map(|at| at < 6).collect::<Vec<_>>());
    member.ends(1).await;
    member.asks().await;
    assert_eq!(member.connections(), 2);
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
