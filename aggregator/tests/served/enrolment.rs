//! The operator enrols and suspends nodes while the aggregator runs, and nobody else does.

use crate::Test;
use ed25519_dalek::SigningKey;
use tonic::Code;
use zk0_aggregator::{Config, Limits};
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::signed::{Enrolment, OperatorDecision, Signed};
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rules::network_rules::EnrolmentRule;
use zk0_protocol::tlog::checkpoint::KeyedCheckpoint;
use zk0_testkit::aggregator::*;
use zk0_testkit::network::log_keys::later_key;

fn enrolment(network: &Digest, node: &SigningNode) -> Enrolment {
    Enrolment {
        network: *network,
        operator: NodeId(log_key().verifying_key().to_bytes()),
        node: node.id(),
        name: format!("node {}", node.seed),
    }
}

async fn enrol(
    network: &Network,
    key: &SigningKey,
    signed: &Signed<Enrolment>,
) -> Result<proto::Receipt, tonic::Status> {
    let request = network.enrolling(key, signed);
    Ok(network.client().await.record(request).await?.into_inner())
}

async fn record(network: &Network, body: &Body) -> Result<proto::Receipt, tonic::Status> {
    let request = network.recording(body);
    Ok(network.client().await.record(request).await?.into_inner())
}

fn config() -> Config {
    Config {
        rounds: Some(1),
        min_nodes: 2,
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_that_is_enrolled_while_the_aggregator_runs_takes_part() -> Test {
    let (first, second) = (SigningNode::new(1), SigningNode::new(2));
    let network = Network::start(&[&first], config()).await;
    first.register(&network).await?;
    let result = second.register(&network).await;
    refused(result, Code::PermissionDenied, "not enrolled");
    let id = network.genesis.network_id();
    let signed = Signed::new(enrolment(&id, &second), &log_key());
    let receipt = enrol(&network, &log_key(), &signed).await?;
    let (_, _, entry) = network.opened(receipt.clone());
    assert!(matches!(entry.body, Body::NodeEnrolled(enrolled) if enrolled.node == second.id()));
    // Whoever has lost the answer asks again, and nothing is recorded twice.
    assert_eq!(enrol(&network, &log_key(), &signed).await?, receipt);
    second.register(&network).await?;
    network.settle().await;
    assert!(network.round(None).await.opened.is_some());
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn nobody_but_the_operator_enrols() -> Test {
    let (first, second) = (SigningNode::new(1), SigningNode::new(2));
    let network = Network::start(&[&first], config()).await;
    let id = network.genesis.network_id();
    let before = network.entries().await.len();
    // Somebody signs in the operator's name.
    let forged = Signed::new(enrolment(&id, &second), &second.key);
    let result = enrol(&network, &log_key(), &forged).await;
    refused(result, Code::Unauthenticated, "signature");
    // Somebody signs in their own name.
    let mut own = enrolment(&id, &second);
    own.operator = second.id();
    let result = enrol(&network, &second.key, &Signed::new(own, &second.key)).await;
    refused(
        result,
        Code::PermissionDenied,
        "only the network's operator",
    );
    // The operator has signed it for another network.
    let elsewhere = enrolment(&Digest([9; 32]), &second);
    let result = enrol(&network, &log_key(), &Signed::new(elsewhere, &log_key())).await;
    refused(result, Code::FailedPrecondition, "network");
    assert_eq!(network.entries().await.len(), before);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn where_a_vote_enrols_the_operator_does_not() -> Test {
    let mut genesis = genesis();
    genesis.rules.enrolment = EnrolmentRule::Vote;
    let limits = Limits::default();
    let network = Network::start_as(&[], config(), limits, genesis, None, None).await;
    let id = network.genesis.network_id();
    let signed = Signed::new(enrolment(&id, &SigningNode::new(1)), &log_key());
    let result = enrol(&network, &log_key(), &signed).await;
    refused(result, Code::FailedPrecondition, "vote");
    Ok(())
}

/// A decision of the operator about this node.
fn decision(network: &Digest, node: &SigningNode, key: &SigningKey) -> OperatorDecision {
    OperatorDecision {
        network: *network,
        operator: NodeId(key.verifying_key().to_bytes()),
        node: node.id(),
        suspended: true,
        number: 0,
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_operator_suspends_a_node_and_ends_that() -> Test {
    let (first, second) = (SigningNode::new(1), SigningNode::new(2));
    let network = Network::start(&[&first, &second], config()).await;
    let id = network.genesis.network_id();
    let decided = |suspended, number, key: &SigningKey| {
        let decision = OperatorDecision {
            suspended,
            number,
            ..decision(&id, &second, key)
        };
        Body::OperatorDecided(Signed::new(decision, key))
    };
    let own = record(&network, &decided(true, 0, &first.key)).await;
    refused(own, Code::FailedPrecondition, "is not the operator");
    let suspended = decided(true, 0, &log_key());
    let receipt = record(&network, &suspended).await?;
    let refused_node = second.register(&network).await;
    refused(
        refused_node,
        Code::PermissionDenied,
        "suspended by the operator",
    );
    // Whoever has lost the answer asks again, and nothing is recorded twice.
    assert_eq!(record(&network, &suspended).await?, receipt);
    record(&network, &decided(false, 1, &log_key())).await?;
    second.register(&network).await?;
    Ok(())
}

/// The operator leaves enrolments to the log's key, and keeps its own key offline for all else.
#[tokio::test(flavor = "multi_thread")]
async fn a_log_key_of_its_own_enrols_and_does_not_suspend() -> Test {
    let (first, second) = (SigningNode::new(1), SigningNode::new(2));
    let mut network = Network::start(&[&first], config()).await;
    let id = network.genesis.network_id();
    let later = later_key(1);
    network.rotate_log_key(later.clone()).await;
    let enrolled = Enrolment {
        operator: NodeId(later.verifying_key().to_bytes()),
        ..enrolment(&id, &second)
    };
    enrol(&network, &later, &Signed::new(enrolled, &later)).await?;
    second.register(&network).await?;
    first.register(&network).await?;
    let by_log = decision(&id, &first, &later);
    let by_log = Body::OperatorDecided(Signed::new(by_log, &later));
    let request = network.stating(&later, &by_log, Vec::new());
    let suspended = network.client().await.record(request).await;
    refused(suspended, Code::FailedPrecondition, "is not the operator");
    // The open round, if any, has no commitment.
    let by_operator = decision(&id, &first, &log_key());
    record(
        &network,
        &Body::OperatorDecided(Signed::new(by_operator, &log_key())),
    )
    .await?;
    Ok(())
}

/// A node that has seen the log's later key takes no other one's receipts, and asks again what it has lost the answer to.
#[tokio::test(flavor = "multi_thread")]
async fn a_receipt_from_before_the_logs_key_is_signed_again() -> Test {
    let first = SigningNode::new(1);
    let mut network = Network::start(&[&first], config()).await;
    let founding = network.genesis.log_key;
    let later = later_key(1);
    let before = first.register(&network).await?;
    network.rotate_log_key(later.clone()).await;
    let after = first.register(&network).await?;
    let origin = network.genesis.origin().to_owned();
    let signer = |receipt: &proto::Receipt| {
        let opened = KeyedCheckpoint::open(receipt.checkpoint.as_bytes(), &origin, &founding);
        opened.unwrap().key
    };
    assert_eq!(signer(&before), founding);
    assert_eq!(signer(&after), later.verifying_key().to_bytes());
    let (before, after) = (network.opened(before), network.opened(after));
    assert_eq!((after.0, after.2), (before.0, before.2));
    Ok(())
}
