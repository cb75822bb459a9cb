//! Updates that nodes put into the bucket by themselves.

use super::{answers_at_once, answers_while_the_store_is_asked, started, started_as, SECONDS};
use std::env;
use std::fs;
use std::time::{Duration, Instant};
use tokio::task::spawn_blocking;
use tokio::time::timeout;
use tonic::{Code, Status};
use zk0_protocol::entries::signed::{Signed, UploadRequest};
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::upload_chunk::Part;
use zk0_testkit::aggregator::*;
use zk0_testkit::s3::failing_network::Fault;
use zk0_testkit::s3::{send, S3};
use zk0_testkit::until_async;
use zk0_verifier::blob_digest;

/// A network with an open round, which gives addresses of the bucket to its nodes.
async fn opened(s3: &S3, node: &SigningNode, seconds: u64) -> Network {
    let mut network = started(s3, node, seconds).await;
    network.presigned = Some(Duration::from_secs(60));
    network.restart().await;
    node.register(&network).await.unwrap();
    network.settle().await;
    network
}

fn signed(network: &Network, node: &SigningNode, update: &[u8]) -> Signed<UploadRequest> {
    let request = node.upload_request(&network.genesis.network_id(), 0, update);
    Signed::new(request, &node.key)
}

async fn address(network: &Network, node: &SigningNode, update: &[u8]) -> String {
    let request = signed(network, node, update);
    node.upload_info(network, &request).await.unwrap().address
}

/// Puts bytes at the address of an update.
async fn put(network: &Network, node: &SigningNode, update: &[u8], bytes: &[u8]) {
    let (address, bytes) = (address(network, node, update).await, bytes.to_vec());
    let status = spawn_blocking(move || send("PUT", &address, &bytes)).await;
    assert_eq!(status.unwrap(), 200);
}

async fn stored(network: &Network, node: &SigningNode, update: &[u8]) -> Result<(), Status> {
    node.stored(network, &signed(network, node, update)).await
}

#[tokio::test(flavor = "multi_thread")]
async fn an_update_in_the_bucket_is_taken_and_committed_to() {
    let Some(s3) = S3::start() else { return };
    let node = SigningNode::new(1);
    let mut network = opened(&s3, &node, 10).await;
    let update = weights(7);
    put(&network, &node, &update, &update).await;
    // It is no blob, and nobody can commit to it, before it is verified.
    let early = node.commit(&network, 0, &update).await;
    refused(early, Code::FailedPrecondition, "upload");
    stored(&network, &node, &update).await.unwrap();
    // Whoever has lost the answer asks again.
    stored(&network, &node, &update).await.unwrap();
    assert!(!s3.file("net", blob_digest(&update)).exists());
    node.commit(&network, 0, &update).await.unwrap();
    let kept = fs::read(s3.file("net", blob_digest(&update))).unwrap();
    assert!(kept == update);
    assert_eq!(s3.objects("net/uploads"), 0);
    let metrics = network.service().metrics().text().unwrap();
    let counted = r#"zk0_uploads_total{from="store"} 1"#;
    assert!(metrics.contains(counted), "{metrics}");
    assert!(
        !metrics.contains(r#"zk0_uploads_total{from="message"}"#),
        "{metrics}"
    );
    network.end().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_not_the_signed_update_is_refused_by_name_and_not_kept() {
    let Some(s3) = S3::start() else { return };
    let node = SigningNode::new(1);
    let mut network = opened(&s3, &node, 10).await;
    let update = weights(7);
    let missing = stored(&network, &node, &update).await;
    refused(
        missing,
        Code::InvalidArgument,
        "nothing was put at the address",
    );
    let mut longer = update.clone();
    longer.push(0);
    let mut other = update.clone();
    other[7] ^= 1;
    let size = format!("{} bytes were put", longer.len());
    for (wrong, words) in [(&longer, &*size), (&other, "SHA-256")] {
        put(&network, &node, &update, wrong).await;
        let taken = stored(&network, &node, &update).await;
        refused(taken, Code::InvalidArgument, words);
        assert_eq!(network.uploads(), 0);
        assert_eq!(s3.objects("net/uploads"), 0);
    }
    node.upload(&network, 0, &update).await.unwrap();
    node.commit(&network, 0, &update).await.unwrap();
    network.end().await;
}

/// Garbage of the right size is read once, and holds nobody. `ZK0_UPDATE_MB` states how much it is, in megabytes.
#[tokio::test(flavor = "multi_thread")]
async fn garbage_of_two_nodes_is_not_kept_and_holds_no_third() {
    let Some(s3) = S3::start() else { return };
    let megabytes = env::var("ZK0_UPDATE_MB").map_or(25, |text| text.parse().unwrap());
    let size = megabytes * 1_000_000;
    let mut genesis = genesis();
    genesis.rules.max_update_bytes = size as u64;
    let nodes = [1, 2, 3].map(SigningNode::new);
    let of: Vec<_> = nodes.iter().collect();
    let mut network = started_as(&s3, &of, genesis, 60).await;
    network.presigned = Some(Duration::from_secs(60));
    network.restart().await;
    for node in &nodes {
        node.register(&network).await.unwrap();
    }
    network.settle().await;
    let [first, second, honest] = &nodes;
    let update = |seed: u8| vec![seed; size];
    for (node, seed) in [(first, 1), (second, 2)] {
        put(&network, node, &update(seed), &update(9)).await;
    }
    put(&network, honest, &update(3), &update(3)).await;
    let reported = |node, seed| signed(&network, node, &update(seed));
    let reported = [reported(first, 1), reported(second, 2), reported(honest, 3)];
    let (one, other, third, ()) = tokio::join!(
        first.stored(&network, &reported[0]),
        second.stored(&network, &reported[1]),
        honest.stored(&network, &reported[2]),
        answers_at_once(&network),
    );
    refused(one, Code::InvalidArgument, "SHA-256");
    refused(other, Code::InvalidArgument, "SHA-256");
    third.unwrap();
    // The honest one's is here, and as a copy there.
    assert_eq!((network.uploads(), s3.objects("net/uploads")), (1, 1));
}

#[tokio::test(flavor = "multi_thread")]
async fn only_who_may_begin_an_upload_gets_an_address() {
    let Some(s3) = S3::start() else { return };
    let node = SigningNode::new(1);
    let mut network = opened(&s3, &node, 10).await;
    let stranger = SigningNode::new(9);
    let request = signed(&network, &stranger, &weights(1));
    let asked = stranger.upload_info(&network, &request).await;
    refused(asked, Code::PermissionDenied, "not enrolled");
    let request = signed(&network, &stranger, &weights(1));
    let reported = stranger.stored(&network, &request).await;
    refused(reported, Code::PermissionDenied, "not enrolled");

    // Who has begun goes on where it was, and who has used up the quota gets none.
    let request = signed(&network, &node, &weights(1));
    let cut = node.upload_as(&network, &request, &weights(1)[..10]).await;
    refused(cut, Code::InvalidArgument, "ended after 10 of");
    assert_eq!(address(&network, &node, &weights(1)).await, "");
    for seed in 2..=4 {
        assert_ne!(address(&network, &node, &weights(seed)).await, "");
        node.upload(&network, 0, &weights(seed)).await.unwrap();
    }
    assert_eq!(address(&network, &node, &weights(5)).await, "");
    let over = stored(&network, &node, &weights(5)).await;
    refused(over, Code::ResourceExhausted, "already uploaded 4");

    // An aggregator that gives no addresses takes nothing from the bucket.
    network.presigned = None;
    network.restart().await;
    assert_eq!(address(&network, &node, &weights(4)).await, "");
    let unasked = stored(&network, &node, &weights(4)).await;
    refused(unasked, Code::InvalidArgument, "has given no address");
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_follows_the_request_of_an_update_in_the_bucket() {
    let Some(s3) = S3::start() else { return };
    let node = SigningNode::new(1);
    let network = opened(&s3, &node, 10).await;
    let update = weights(7);
    put(&network, &node, &update, &update).await;
    let request = signed(&network, &node, &update);
    let statement = borsh::to_vec(&request).unwrap();
    let parts = [Part::Stored(statement), Part::Data(update.clone())].map(|part| {
        let part = Some(part);
        proto::UploadChunk { part, begins: 0 }
    });
    let uploading = node.uploading(&network, &request, tokio_stream::iter(parts));
    let sent = network.client().await.upload(uploading).await;
    refused(sent, Code::InvalidArgument, "nothing follows the request");
    stored(&network, &node, &update).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_bucket_that_fails_holds_neither_the_node_nor_others() {
    let Some(s3) = S3::start() else { return };
    let node = SigningNode::new(1);
    let network = opened(&s3, &node, SECONDS).await;
    let update = weights(7);
    put(&network, &node, &update, &update).await;
    for fault in [Fault::Unavailable, Fault::Silent] {
        s3.network.fail_always(fault);
        let begun = Instant::now();
        let (taken, ()) = tokio::join!(
            stored(&network, &node, &update),
            answers_while_the_store_is_asked(&network, &s3)
        );
        refused(taken, Code::Unavailable, "blob store does not answer");
        assert!(begun.elapsed() < Duration::from_secs(40), "{fault:?}");
        assert_eq!(network.uploads(), 0);
    }
    // A newer upload does not wait for one that the bucket holds for long.
    s3.network.fail_always(Fault::Silent);
    let (held, newer) = tokio::join!(stored(&network, &node, &update), async {
        answers_while_the_store_is_asked(&network, &s3).await;
        let newer = node.upload(&network, 0, &update);
        timeout(Duration::from_secs(20), newer).await
    });
    refused(held, Code::ResourceExhausted, "a newer upload");
    newer.unwrap().unwrap();
    s3.network.mend();
    node.commit(&network, 0, &update).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn what_nobody_claims_is_removed_when_its_round_has_closed() {
    let Some(s3) = S3::start() else { return };
    let node = SigningNode::new(1);
    let network = opened(&s3, &node, 10).await;
    put(&network, &node, &weights(7), &weights(7)).await;
    node.upload(&network, 0, &weights(8)).await.unwrap();
    node.commit(&network, 0, &weights(8)).await.unwrap();
    network.drawn().await;
    assert_eq!(s3.objects("net/uploads"), 1);
    network.clock.advance(SUBMIT_MS + 1);
    until_async("it is removed", async || s3.objects("net/uploads") == 0).await;
}
