//! Whoever follows a round or watches the server's health is told when the server ends, and asks again after a while.

use super::{network, with};
use crate::Test;
use std::time::Duration;
use tokio::time::timeout;
use tonic::transport::Endpoint;
use tonic::{Status, Streaming};
use zk0_aggregator::{ConnectionLimits, Limits};
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::health::health_client::HealthClient;
use zk0_protocol::rpc::health::{HealthCheckRequest, HealthCheckResponse};
use zk0_testkit::aggregator::*;

/// Far more than these streams need to end.
const SOON: Duration = Duration::from_secs(20);

/// Somebody who follows the rounds, and a monitor. Each has its own connection.
struct Followers {
    rounds: Streaming<proto::RoundInfo>,
    health: Streaming<HealthCheckResponse>,
}

impl Followers {
    /// Both have been told something.
    async fn of(network: &Network) -> Result<Self, Box<dyn std::error::Error>> {
        let request = proto::GetRoundRequest {
            round: None,
            node: Vec::new(),
        };
        let rounds = network.client().await.watch_round(request).await?;
        let channel = Endpoint::try_from(network.address.clone())?
            .connect()
            .await?;
        let request = HealthCheckRequest {
            service: String::new(),
        };
        let health = HealthClient::new(channel).watch(request).await?;
        let mut followers = Self {
            rounds: rounds.into_inner(),
            health: health.into_inner(),
        };
        assert!(followers.rounds.message().await?.is_some());
        assert!(followers.health.message().await?.is_some());
        Ok(followers)
    }

    /// Waits until both streams have ended. It is an error if one is cut.
    async fn ended(mut self) -> Test {
        let ended = async {
            while self.rounds.message().await?.is_some() {}
            while self.health.message().await?.is_some() {}
            Ok::<_, Status>(())
        };
        timeout(SOON, ended).await??;
        Ok(())
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_end_waits_for_nobody_who_follows() -> Test {
    let (mut network, [node, _]) = with(ConnectionLimits {
        drain: Duration::from_secs(60),
        ..ConnectionLimits::default()
    })
    .await;
    node.register(&network).await?;
    network.settle().await;
    let followers = Followers::of(&network).await?;
    timeout(SOON, network.stop()).await?;
    followers.ended().await
}

#[tokio::test(flavor = "multi_thread")]
async fn whoever_follows_has_to_ask_again_after_a_while() -> Test {
    let (network, _) = network(Limits {
        watch: Duration::from_secs(1),
        ..Limits::default()
    })
    .await;
    Followers::of(&network).await?.ended().await
}
