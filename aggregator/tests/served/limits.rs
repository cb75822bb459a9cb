//! The aggregator withstands floods, huge requests and full quotas. Limits act before any work, and memory and disk stay bounded.

use crate::Test;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Code, Status};
use zk0_aggregator::round::intake::registrations::PERIOD_MS;
use zk0_aggregator::{Config, Limits};
use zk0_circuits::vm::merkle;
use zk0_circuits::Digest;
use zk0_protocol::entries::signed::{
    KeyRotation, KeyTakeover, RegisteredEpisode, Signed, UploadRequest,
};
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::upload_chunk::Part;
use zk0_protocol::rules::apply::MAX_EPISODES;
use zk0_protocol::Body;
use zk0_testkit::aggregator::*;
use zk0_verifier::blob_digest;

fn part(part: Part) -> proto::UploadChunk {
    proto::UploadChunk {
        part: Some(part),
        begins: 0,
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_message_over_the_limit_is_not_decoded() -> Test {
    let (network, first, _) = open_round().await;
    committed(&network, &first, 0, 1).await;
    let claim = first.claim(&network).await;
    let before = network.entries().await.len();
    let status = first
        .submit(&network, claim, &vec![0; 5 << 20])
        .await
        .unwrap_err();
    assert!(
        matches!(status.code(), Code::OutOfRange | Code::ResourceExhausted),
        "{status}"
    );
    assert_eq!(network.entries().await.len(), before);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_proof_over_the_rules_limit_is_refused() -> Test {
    let (network, first, _) = open_round().await;
    committed(&network, &first, 0, 1).await;
    let claim = first.claim(&network).await;
    let result = first
        .submit(&network, claim, &vec![0; MAX_PROOF_BYTES as usize + 1])
        .await;
    refused(
        result,
        Code::ResourceExhausted,
        "the proof has 100001 bytes",
    );
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_over_the_rules_limit_is_refused_before_it_is_read() -> Test {
    let (network, first, _) = open_round().await;
    let mut request = first.upload_request(&network.genesis.network_id(), 0, b"");
    request.size = MAX_UPDATE_BYTES + 1;
    let request = Signed::new(request, &first.key);
    refused(
        first.upload_as(&network, &request, &[0; 10]).await,
        Code::ResourceExhausted,
        "the rules allow at most 200000",
    );
    assert_eq!(network.uploads(), 0);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn an_endless_upload_is_cut_at_its_announced_size() -> Test {
    let (network, first, _) = open_round().await;
    let mut request = first.upload_request(&network.genesis.network_id(), 0, b"");
    request.size = 100_000;
    let request = Signed::new(request, &first.key);
    let first_part = part(Part::Request(borsh::to_vec(&request)?));
    let (sender, receiver) = mpsc::channel(1);
    let endless_request = first.uploading(&network, &request, ReceiverStream::new(receiver));
    let endless = tokio::spawn(async move {
        let _ = sender.send(first_part).await;
        let mut sent = 0u64;
        while sender.send(part(Part::Data(vec![0; 10_000]))).await.is_ok() {
            sent += 10_000;
            if sent > 1 << 30 {
                break;
            }
        }
        sent
    });
    let result = network.client().await.upload(endless_request).await;
    refused(result, Code::ResourceExhausted, "the update has");
    // The upload stops soon after. A few windows of HTTP/2 are on their way by then, not a gigabyte.
    let sent = tokio::time::timeout(Duration::from_secs(10), endless).await??;
    assert!(sent < 20 << 20, "{sent} bytes were taken");
    assert_eq!(network.uploads(), 0);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_that_is_not_what_was_announced_is_not_kept() -> Test {
    let (network, first, _) = open_round().await;
    let update = weights(1);
    let mut request = first.upload_request(&network.genesis.network_id(), 0, &update);
    request.blob = Digest([3; 32]);
    let request = Signed::new(request, &first.key);
    refused(
        first.upload_as(&network, &request, &update).await,
        Code::InvalidArgument,
        "SHA-256",
    );
    let request = Signed::new(
        first.upload_request(&network.genesis.network_id(), 0, &update),
        &first.key,
    );
    let short = first.upload_as(&network, &request, &update[..2000]).await;
    refused(short, Code::InvalidArgument, "ended after 2000 of");
    assert_eq!(network.uploads(), 1);
    first.go_on(&network, &request, &update, 2000).await?;
    first.upload_as(&network, &request, &update).await?;
    assert_eq!(network.uploads(), 1);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_begins_with_its_request() -> Test {
    let (network, ..) = open_round().await;
    let mut client = network.client().await;
    let data = tokio_stream::iter([part(Part::Data(vec![0; 10]))]);
    refused(
        client.upload(data).await,
        Code::InvalidArgument,
        "signed request",
    );
    let empty = tokio_stream::iter([proto::UploadChunk {
        part: None,
        begins: 0,
    }]);
    refused(client.upload(empty).await, Code::InvalidArgument, "empty");
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_has_four_uploads_in_a_round() -> Test {
    let (network, first, second) = open_round().await;
    for seed in 1..=4 {
        first.upload(&network, 0, &weights(seed)).await?;
    }
    // An upload of an update that is there already costs nothing.
    first.upload(&network, 0, &weights(4)).await?;
    refused(
        first.upload(&network, 0, &weights(5)).await,
        Code::ResourceExhausted,
        "already uploaded 4",
    );
    second.upload(&network, 0, &weights(5)).await?;
    assert_eq!(network.uploads(), 5);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_not_committed_goes_when_the_round_does() -> Test {
    let (network, first, _) = open_round().await;
    first.upload(&network, 0, &weights(1)).await?;
    assert_eq!(network.uploads(), 1);
    network.clock.advance(SUBMIT_MS + 1);
    network.settle().await;
    assert_eq!(network.uploads(), 0);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn the_longest_list_of_episodes_is_registered() -> Test {
    let node = SigningNode::new(1);
    let config = Config {
        rounds: Some(1),
        min_nodes: 2,
    };
    let network = Network::start(&[&node], config).await;
    let mut registration = node.registration(&network.genesis.network_id()).statement;
    registration.episodes = (0..MAX_EPISODES as u32)
        .map(|number| {
            let mut digest = [1; 32];
            digest[..4].copy_from_slice(&number.to_be_bytes());
            RegisteredEpisode {
                digest: Digest(digest),
                frames: 400,
            }
        })
        .collect();
    registration.leaves = blob_digest(&list(&registration, &node.leaves()));
    let signed = Signed::new(registration, &node.key);
    node.register_as(&network, &signed, &node.leaves()).await?;
    Ok(())
}

/// Registers the node's samples under another salt.
async fn register_again(network: &Network, node: &SigningNode, salt: u8) -> Result<(), Status> {
    let leaves: Vec<_> = (0..10)
        .map(|at| {
            let mut leaf = [salt; 32];
            leaf[0] = at;
            Digest(leaf)
        })
        .collect();
    let mut registration = node.registration(&network.genesis.network_id()).statement;
    registration.dataset.root = merkle::root(&leaves);
    registration.leaves = blob_digest(&list(&registration, &leaves));
    let signed = Signed::new(registration, &node.key);
    node.register_as(network, &signed, &leaves).await.map(drop)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_registers_four_times_until_a_round_has_closed() -> Test {
    let (first, second, next) = (
        SigningNode::new(1),
        SigningNode::new(2),
        SigningNode::new(7),
    );
    let config = Config {
        rounds: Some(1),
        min_nodes: 2,
    };
    let mut network = Network::start(&[&first, &second], config).await;
    for salt in 1..=4 {
        register_again(&network, &first, salt).await?;
    }
    let (code, often) = (Code::ResourceExhausted, "has registered 4 datasets");
    refused(register_again(&network, &first, 5).await, code, often);
    // Whoever has lost the answer asks again.
    register_again(&network, &first, 4).await?;
    network.restart().await;
    refused(register_again(&network, &first, 5).await, code, often);
    // Under another key it is the same node.
    let rotation = KeyRotation {
        network: network.genesis.network_id(),
        node: first.id(),
        with: next.id(),
    };
    let rotated = Body::KeyRotated {
        rotation: Signed::new(rotation, &first.key),
        takeover: Signed::new(KeyTakeover { rotation }, &next.key),
    };
    let request = network.recording(&rotated);
    network.client().await.record(request).await?;
    refused(register_again(&network, &next, 5).await, code, often);

    network.clock.advance(PERIOD_MS);
    for salt in 5..=8 {
        register_again(&network, &next, salt).await?;
    }
    refused(register_again(&network, &next, 9).await, code, often);
    second.register(&network).await?;
    network.settle().await;
    network.clock.advance(SUBMIT_MS + COMMIT_MS);
    network.settle().await;
    assert!(network.round(Some(0)).await.closed.is_some());
    register_again(&network, &next, 9).await?;
    Ok(())
}

/// A network of one node in round 0, with little patience.
async fn impatient(limits: Limits) -> (Network, SigningNode) {
    let node = SigningNode::new(1);
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let network = Network::start_with(&[&node], config, limits).await;
    node.register(&network).await.unwrap();
    network.settle().await;
    (network, node)
}

fn begun(
    network: &Network,
    node: &SigningNode,
    update: &[u8],
) -> (Signed<UploadRequest>, [proto::UploadChunk; 2]) {
    let request = node.upload_request(&network.genesis.network_id(), 0, update);
    let request = Signed::new(request, &node.key);
    let statement = borsh::to_vec(&request).unwrap();
    let parts = [
        part(Part::Request(statement)),
        part(Part::Data(update[..100].to_vec())),
    ];
    (request, parts)
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_that_trickles_is_cut() -> Test {
    let limits = Limits {
        upload: Duration::from_millis(500),
        ..Limits::default()
    };
    let (network, node) = impatient(limits).await;
    let update = weights(1);
    let (sender, receiver) = mpsc::channel(4);
    let (request, parts) = begun(&network, &node, &update);
    for part in parts {
        sender.send(part).await?;
    }
    let trickle = tokio::spawn(async move {
        while sender.send(part(Part::Data(vec![0]))).await.is_ok() {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    });
    let mut client = network.client().await;
    let request = node.uploading(&network, &request, ReceiverStream::new(receiver));
    let result = client.upload(request).await;
    refused(result, Code::DeadlineExceeded, "the upload took");
    trickle.await?;
    // What has come counts.
    let (request, _) = begun(&network, &node, &update);
    assert!(node.held(&network, &request).await? > 100);
    Ok(())
}
