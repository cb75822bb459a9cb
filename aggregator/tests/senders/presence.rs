//! Rounds that wait until enough nodes are present, and nodes that leave.

use crate::Test;
use std::time::Duration;
use tokio::time::timeout;
use tonic::{Code, Status, Streaming};
use zk0_aggregator::{Config, Limits};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::signed::{Enrolment, Leaving, Signed};
use zk0_protocol::request_head::Method;
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rules::network_rules::Participation;
use zk0_testkit::aggregator::*;
use zk0_testkit::until_async;

const SOON: Duration = Duration::from_secs(10);

/// A network of three nodes with datasets, whose rounds wait for so many of them.
async fn waiting(min_nodes: u32, fraction_bps: u32) -> (Network, [SigningNode; 3]) {
    let nodes = [1, 2, 3].map(SigningNode::new);
    let mut genesis = genesis();
    genesis.rules.participation = Participation::Present {
        min_nodes,
        fraction_bps,
    };
    let config = Config {
        rounds: Some(3),
        min_nodes: 1,
    };
    let all: Vec<_> = nodes.iter().collect();
    let limits = Limits::default();
    let network = Network::start_as(&all, config, limits, genesis, None, None).await;
    for node in &nodes {
        node.register(&network).await.unwrap();
    }
    network.settle().await;
    (network, nodes)
}

fn question(node: &SigningNode) -> proto::GetRoundRequest {
    proto::GetRoundRequest {
        round: None,
        node: node.id().0.to_vec(),
    }
}

/// A node follows the rounds, and signs that.
async fn follow(
    network: &Network,
    node: &SigningNode,
) -> Result<Streaming<proto::RoundInfo>, Status> {
    let message = question(node);
    let statement = message.node.clone();
    let request = network.request(&node.key, Method::WatchRound, None, &statement, message);
    let rounds = network.client().await.watch_round(request).await?;
    Ok(rounds.into_inner())
}

async fn opened(network: &Network) -> bool {
    network.settle().await;
    network.round(None).await.opened.is_some()
}

/// Waits until the aggregator has noticed that a node has gone.
async fn noticed(network: &Network, node: &SigningNode) {
    let id = node.id();
    let presence = network
        .service()
        .with(|aggregator| Ok(aggregator.presence().clone()))
        .await
        .unwrap();
    // A node that has gone a minute ago is not present.
    let gone = async || {
        network.clock.advance(60_000);
        presence.among([&id].into_iter()) == 0
    };
    until_async("the node has gone", gone).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_round_waits_until_enough_nodes_are_present() -> Test {
    let (network, [first, second, third]) = waiting(2, 0).await;
    assert!(!opened(&network).await);
    let mut told = follow(&network, &first).await?;
    assert!(!opened(&network).await);
    let _second = follow(&network, &second).await?;
    assert!(opened(&network).await);
    // Whoever follows the rounds is told, and who was absent may contribute all the same.
    let mut round = proto::RoundInfo::default();
    while round.opened.is_none() {
        round = timeout(SOON, told.message()).await??.ok_or("no round")?;
    }
    assert!(round.invited);
    committed(&network, &third, 0, 3).await;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_round_waits_for_its_fraction_of_the_nodes() -> Test {
    let (network, [first, second, third]) = waiting(1, 10_000).await;
    let _first = follow(&network, &first).await?;
    let _second = follow(&network, &second).await?;
    assert!(!opened(&network).await);
    let _third = follow(&network, &third).await?;
    assert!(opened(&network).await);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn nobody_is_present_in_the_name_of_another() -> Test {
    let (network, [first, second, _]) = waiting(2, 0).await;
    let _first = follow(&network, &first).await?;
    // Anybody may follow the rounds for a node, but without its signature that does not count.
    let mut client = network.client().await;
    let _unsigned = client.watch_round(question(&second)).await?.into_inner();
    let message = question(&second);
    let statement = message.node.clone();
    let forged = network.request(&first.key, Method::WatchRound, None, &statement, message);
    let refusal = client.watch_round(forged).await;
    refused(refusal.map(drop), Code::Unauthenticated, "only the signer");
    assert!(!opened(&network).await);
    // The same node twice is one node.
    let _again = follow(&network, &first).await?;
    assert!(!opened(&network).await);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_is_present_for_a_minute_after_it_has_gone() -> Test {
    let (network, [first, second, _]) = waiting(2, 0).await;
    drop(follow(&network, &first).await?);
    noticed(&network, &first).await;
    let _second = follow(&network, &second).await?;
    assert!(!opened(&network).await);
    drop(follow(&network, &first).await?);
    network.in_progress("WatchRound", 1).await;
    assert!(opened(&network).await);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_that_has_left_is_not_waited_for_until_it_is_enrolled_again() -> Test {
    let (network, [first, second, third]) = waiting(1, 10_000).await;
    let id = network.genesis.network_id();
    let leave = |round| {
        let leaving = Leaving {
            network: id,
            node: third.id(),
            round,
        };
        Body::NodeLeft(Signed::new(leaving, &third.key))
    };
    let record = async |body: Body| {
        let request = network.recording(&body);
        let receipt = network.client().await.record(request).await?;
        Ok::<_, Status>(receipt.into_inner())
    };
    refused(
        record(leave(1)).await,
        Code::FailedPrecondition,
        "the next round is 0",
    );
    let receipt = record(leave(0)).await?;
    // Whoever has lost the answer asks again.
    assert_eq!(record(leave(0)).await?, receipt);
    let asked = proto::GetStatusRequest {};
    let status = network.client().await.get_status(asked).await?.into_inner();
    assert_eq!((status.enrolled, status.ready), (2, 2));
    let _first = follow(&network, &first).await?;
    let _second = follow(&network, &second).await?;
    assert!(opened(&network).await);
    let mut told = follow(&network, &third).await?;
    let round = timeout(SOON, told.message()).await??.ok_or("no round")?;
    assert!(!round.invited);
    let update = weights(3);
    let commitment = third.commit(&network, 0, &update).await;
    refused(commitment, Code::PermissionDenied, "it has left");
    // The round does not wait for its commitment either.
    for (node, seed) in [(&first, 1), (&second, 2)] {
        committed(&network, node, 0, seed).await;
    }
    network.settle().await;
    assert!(network.round(None).await.commitments_closed.is_some());

    // The operator enrols it again under the same name, and it leaves again.
    let enrolment = Enrolment {
        network: id,
        operator: zk0_circuits::NodeId(log_key().verifying_key().to_bytes()),
        node: third.id(),
        name: "node-2".into(),
    };
    let enrolment = Signed::new(enrolment, &log_key());
    let enrol = async || {
        let request = network.enrolling(&log_key(), &enrolment);
        let receipt = network.client().await.record(request).await?;
        Ok::<_, Status>(receipt.into_inner().index)
    };
    let mut entries = Vec::new();
    for _ in 0..2 {
        entries.push(enrol().await?);
        entries.push(record(leave(1)).await?.index);
    }
    assert!(entries.is_sorted_by(|one, next| one < next), "{entries:?}");
    Ok(())
}
