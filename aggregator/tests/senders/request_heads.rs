//! The signed heads of requests: whoever has read one cannot use it for anything else.

use crate::Test;
use std::time::Duration;
use tonic::{Code, Request, Status};
use zk0_aggregator::{Config, Limits};
use zk0_circuits::Digest;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::proposal::Action;
use zk0_protocol::entries::signed::{Enrolment, Signed};
use zk0_protocol::request_head::{Method, RequestHead};
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::record_request::Statement;
use zk0_protocol::rpc::head_metadata::{with_head, HEAD};
use zk0_testkit::aggregator::*;

/// A network in round 0, a node that has uploaded an update, and its commitment to it.
async fn uploaded() -> (Network, SigningNode, proto::RecordRequest) {
    let (network, first, _) = open_round().await;
    let update = weights(1);
    first.upload(&network, 0, &update).await.unwrap();
    let commitment = first.commitment(&network.genesis.network_id(), 0, &update);
    let commitment = Body::UpdateCommitted(Signed::new(commitment, &first.key));
    (network, first, with_leaves(&commitment, Vec::new()))
}

fn head_of(network: &Network, node: &SigningNode, message: &proto::RecordRequest) -> RequestHead {
    let Some(Statement::Body(body)) = &message.statement else {
        panic!("{message:?}");
    };
    network.head(&node.key, Method::Record, Some(0), body)
}

async fn commit(network: &Network, request: Request<proto::RecordRequest>) -> Result<(), Status> {
    network.client().await.record(request).await.map(drop)
}

/// A change of a head, and the words with which it is refused.
type Change = (fn(&mut RequestHead), &'static str);

const CHANGES: [Change; 7] = [
    (|head| head.network = Digest([9; 32]), "is for network 0909"),
    (|head| head.run[0] ^= 1, "was started again"),
    (
        |head| head.method = Method::Upload,
        "is for Upload, not for Record",
    ),
    (
        |head| head.round = None,
        "is for no round, but its message is for round 0",
    ),
    (
        |head| head.body = Digest([9; 32]),
        "message with SHA-256 0909",
    ),
    (
        |head| head.sender = SigningNode::new(2).id(),
        "only the signer sends it",
    ),
    (|head| head.time_ms -= 120_001, "differ by 120.001 s"),
];

#[tokio::test(flavor = "multi_thread")]
async fn each_field_of_a_head_is_compared_with_its_request() -> Test {
    let (network, node, message) = uploaded().await;
    let before = network.entries().await.len();
    for (change, words) in CHANGES {
        let mut head = head_of(&network, &node, &message);
        change(&mut head);
        // Whoever signs it: somebody who has taken the node's head, the node itself, or the one that the head names.
        for key in [
            &SigningNode::new(3).key,
            &node.key,
            &SigningNode::new(2).key,
        ] {
            let head = Signed::new(head.clone(), key);
            let result = commit(&network, with_head(message.clone(), &head)).await;
            let status = result.unwrap_err();
            let forged = key.verifying_key().to_bytes() != head.statement.sender.0;
            let refused = status.message().contains(words);
            let unsigned = status.message().contains("the signature is not");
            assert!(refused || (forged && unsigned), "{status}");
        }
    }
    assert_eq!(network.entries().await.len(), before);
    let head = Signed::new(head_of(&network, &node, &message), &node.key);
    commit(&network, with_head(message, &head)).await?;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_head_is_signed_by_its_sender() -> Test {
    let (network, node, message) = uploaded().await;
    let head = head_of(&network, &node, &message);
    let mut changed = Signed::new(head.clone(), &node.key);
    changed.statement.nonce[0] ^= 1;
    let forged = Signed::new(head, &SigningNode::new(2).key);
    for head in [changed, forged] {
        let result = commit(&network, with_head(message.clone(), &head)).await;
        refused(result, Code::Unauthenticated, "the signature is not");
    }
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_head_counts_once() -> Test {
    let (network, node, message) = uploaded().await;
    let head = Signed::new(head_of(&network, &node, &message), &node.key);
    commit(&network, with_head(message.clone(), &head)).await?;
    let again = commit(&network, with_head(message.clone(), &head)).await;
    refused(again, Code::AlreadyExists, "has come before");
    // The node itself asks again with another head, and gets the same receipt.
    let head = Signed::new(head_of(&network, &node, &message), &node.key);
    commit(&network, with_head(message, &head)).await?;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_head_is_neither_old_nor_of_the_future() -> Test {
    let (network, node, message) = uploaded().await;
    let at = |time_ms| {
        let head = RequestHead {
            time_ms,
            ..head_of(&network, &node, &message)
        };
        with_head(message.clone(), &Signed::new(head, &node.key))
    };
    for (time_ms, words) in [
        (
            START_MS - 120_001,
            "differ by 120.001 s, and 120.000 s are allowed",
        ),
        (
            START_MS + 120_001,
            "differ by 120.001 s, and 120.000 s are allowed",
        ),
    ] {
        let result = commit(&network, at(time_ms)).await;
        refused(result, Code::Unavailable, words);
    }
    commit(&network, at(START_MS - 120_000)).await?;
    commit(&network, at(START_MS + 120_000)).await?;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn the_operator_chooses_how_much_clocks_may_differ() -> Test {
    let node = SigningNode::new(1);
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let limits = Limits {
        skew: Duration::from_secs(5),
        ..Limits::default()
    };
    let network = Network::start_with(&[&node], config, limits).await;
    let registration = node.registration(&network.genesis.network_id());
    let request = node.registering(&network, &registration, node.list());
    network.clock.advance(5001);
    let late = network.client().await.record(request).await;
    refused(late, Code::Unavailable, "5.000 s are allowed");
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_restart_lets_no_head_count_again() -> Test {
    let (mut network, node, message) = uploaded().await;
    let head = Signed::new(head_of(&network, &node, &message), &node.key);
    commit(&network, with_head(message.clone(), &head)).await?;
    // The clock stands still, so by its time the head could count.
    network.restart().await;
    let again = commit(&network, with_head(message.clone(), &head)).await;
    refused(again, Code::Unavailable, "was started again");
    // The aggregator states which run it is now.
    let request = proto::GetNetworkRequest {};
    let info = network.client().await.get_network(request).await?;
    assert_eq!(info.into_inner().run, network.service().run());
    let head = Signed::new(head_of(&network, &node, &message), &node.key);
    commit(&network, with_head(message, &head)).await?;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_head_is_a_bounded_encoding() -> Test {
    let (network, node, message) = uploaded().await;
    let head = Signed::new(head_of(&network, &node, &message), &node.key);
    let head = borsh::to_vec(&head)?;
    let longer = [&head[..], &[0]].concat();
    for (bytes, words) in [
        (Some(&head[1..]), "is not valid"),
        (Some(&longer[..]), "is not valid"),
        (Some(&[0; 513][..]), "it has 513 bytes, at most 512"),
        (None, "no signed head"),
    ] {
        let mut request = Request::new(message.clone());
        if let Some(bytes) = bytes {
            let value = tonic::metadata::MetadataValue::from_bytes(bytes);
            request.metadata_mut().insert_bin(HEAD, value);
        }
        refused(
            commit(&network, request).await,
            Code::Unauthenticated,
            words,
        );
    }
    Ok(())
}

/// Each method that changes something asks for a head of its own.
#[tokio::test(flavor = "multi_thread")]
async fn no_request_changes_anything_without_its_head() -> Test {
    let (network, first, second) = open_round().await;
    let id = network.genesis.network_id();
    let mut client = network.client().await;
    let before = network.entries().await.len();
    let bare = "no signed head";

    let registration = Body::DatasetCommitted(second.registration(&id));
    let result = client.record(with_leaves(&registration, second.list()));
    refused(result.await, Code::Unauthenticated, bare);

    let enrolment = Enrolment {
        network: id,
        operator: zk0_circuits::NodeId(log_key().verifying_key().to_bytes()),
        node: SigningNode::new(3).id(),
        name: "third".into(),
    };
    let enrolment = borsh::to_vec(&Signed::new(enrolment, &log_key()))?;
    let message = proto::RecordRequest {
        statement: Some(Statement::Enrolment(enrolment)),
        leaves: Vec::new(),
    };
    refused(client.record(message).await, Code::Unauthenticated, bare);

    let state = |aggregator: &mut zk0_aggregator::Aggregator| Ok(aggregator.state().clone());
    let state = network.service().with(state).await.unwrap();
    let action = Action::RestoreWeights { round: 0 };
    let proposed = with_leaves(&operator::proposed(&state, action), Vec::new());
    refused(client.record(proposed).await, Code::Unauthenticated, bare);

    let update = weights(1);
    let request = first.upload_request(&id, 0, &update);
    let request = borsh::to_vec(&Signed::new(request, &first.key))?;
    let part = proto::upload_chunk::Part::Request(request);
    let parts = tokio_stream::iter([proto::UploadChunk {
        part: Some(part),
        begins: 0,
    }]);
    refused(client.upload(parts).await, Code::Unauthenticated, bare);
    assert_eq!(network.uploads(), 0);

    committed(&network, &second, 0, 2).await;
    let claim = second.claim(&network).await;
    let submission = borsh::to_vec(&second.submission(claim, b"no proof"))?;
    let message = proto::SubmitRequest {
        submission,
        proof: b"no proof".to_vec(),
    };
    refused(client.submit(message).await, Code::Unauthenticated, bare);
    // The commitment, its close and the randomness are all that was recorded.
    let entries = network.entries().await;
    assert_eq!(entries.len(), before + 3);
    assert!(matches!(entries[before].body, Body::UpdateCommitted(_)));
    Ok(())
}
