//! Uploads that were cut.

use crate::Test;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::time::timeout;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Code, Status};
use zk0_aggregator::Aggregator;
use zk0_protocol::entries::signed::{Signed, UploadRequest};
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::upload_chunk::Part;
use zk0_testkit::aggregator::*;
use zk0_testkit::until_async;

pub fn signed(network: &Network, node: &SigningNode, update: &[u8]) -> Signed<UploadRequest> {
    let request = node.upload_request(&network.genesis.network_id(), 0, update);
    Signed::new(request, &node.key)
}

/// An upload whose node has sent `sent` bytes and is silent then.
async fn silent_after(
    network: &Network,
    node: &SigningNode,
    update: &[u8],
    sent: usize,
) -> (
    mpsc::Sender<proto::UploadChunk>,
    tokio::task::JoinHandle<Result<(), Status>>,
) {
    let request = signed(network, node, update);
    let (sender, receiver) = mpsc::channel(4);
    for part in [
        Part::Request(borsh::to_vec(&request).unwrap()),
        Part::Data(update[..sent].to_vec()),
    ] {
        let part = Some(part);
        sender
            .send(proto::UploadChunk { part, begins: 0 })
            .await
            .unwrap();
    }
    let uploading = node.uploading(network, &request, ReceiverStream::new(receiver));
    let mut client = network.client().await;
    let uploading = tokio::spawn(async move { client.upload(uploading).await.map(drop) });
    (sender, uploading)
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_goes_on_after_what_has_come_even_when_the_aggregator_was_killed() -> Test {
    let (mut network, first, _) = open_round().await;
    let update = weights(1);
    let request = signed(&network, &first, &update);
    assert_eq!(first.held(&network, &request).await?, 0);
    let (sender, uploading) = silent_after(&network, &first, &update, 3000).await;
    drop(sender);
    refused(
        uploading.await?,
        Code::InvalidArgument,
        "ended after 3000 of",
    );
    assert_eq!(first.held(&network, &request).await?, 3000);
    network.restart().await;
    assert_eq!(first.held(&network, &request).await?, 3000);
    for begins in [0, 2999, 3001] {
        refused(
            first.go_on(&network, &request, &update, begins).await,
            Code::Aborted,
            "and 3000 bytes of the update are here",
        );
    }
    first.go_on(&network, &request, &update, 3000).await?;
    assert_eq!(first.held(&network, &request).await?, update.len() as u64);
    assert_eq!(network.uploads(), 1);
    first.commit(&network, 0, &update).await?;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_newer_upload_ends_the_one_before_whose_connection_is_lost() -> Test {
    let (network, first, second) = open_round().await;
    let (update, other) = (weights(1), weights(2));
    let (_sender, lost) = silent_after(&network, &first, &update, 3000).await;
    // Nobody notices that the connection is lost. Another node is not held up, and this one neither.
    second.upload(&network, 0, &weights(3)).await?;
    timeout(Duration::from_secs(10), first.upload(&network, 0, &other)).await??;
    refused(
        timeout(Duration::from_secs(10), lost).await??,
        Code::ResourceExhausted,
        "a newer upload",
    );
    first.commit(&network, 0, &other).await?;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn parts_count_as_uploads() -> Test {
    let (network, first, _) = open_round().await;
    for seed in 1..=4 {
        let update = weights(seed);
        let request = signed(&network, &first, &update);
        let cut = first.upload_as(&network, &request, &update[..10]).await;
        refused(cut, Code::InvalidArgument, "ended after 10 of");
    }
    refused(
        first.upload(&network, 0, &weights(5)).await,
        Code::ResourceExhausted,
        "already uploaded 4",
    );
    let update = weights(4);
    let request = signed(&network, &first, &update);
    first.go_on(&network, &request, &update, 10).await?;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn the_last_upload_goes_on_although_it_was_cut_before_its_first_byte() -> Test {
    let (network, first, _) = open_round().await;
    for seed in 1..=4 {
        let request = signed(&network, &first, &weights(seed));
        let cut = first.upload_as(&network, &request, &[]).await;
        refused(cut, Code::InvalidArgument, "ended after 0 of");
    }
    refused(
        first.upload(&network, 0, &weights(5)).await,
        Code::ResourceExhausted,
        "already uploaded 4",
    );
    let update = weights(4);
    first.upload(&network, 0, &update).await?;
    first.commit(&network, 0, &update).await?;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_part_that_is_damaged_is_removed() -> Test {
    let (network, first, _) = open_round().await;
    let update = weights(1);
    let request = signed(&network, &first, &update);
    let mut damaged = update.clone();
    damaged[7] ^= 1;
    let cut = first.upload_as(&network, &request, &damaged[..2000]).await;
    refused(cut, Code::InvalidArgument, "ended after 2000 of");
    refused(
        first.go_on(&network, &request, &update, 2000).await,
        Code::InvalidArgument,
        "SHA-256",
    );
    assert_eq!(first.held(&network, &request).await?, 0);
    first.upload_as(&network, &request, &update).await?;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_that_fails_does_not_keep_the_aggregator() -> Test {
    let (network, first, _) = open_round().await;
    // The aggregator is always busy, so whoever wants it waits for it.
    let service = network.service().clone();
    let busy = tokio::spawn(async move {
        let work = |_: &mut Aggregator| {
            std::thread::sleep(Duration::from_millis(2));
            Ok(())
        };
        while service.with(work).await.is_ok() {}
    });
    let update = weights(1);
    let request = signed(&network, &first, &update);
    let mut damaged = update.clone();
    damaged[7] ^= 1;
    for _ in 0..20 {
        let failed = first.upload_as(&network, &request, &damaged);
        let failed = timeout(Duration::from_secs(10), failed).await?;
        refused(failed, Code::InvalidArgument, "SHA-256");
    }
    busy.abort();
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn only_the_node_learns_how_much_has_come() -> Test {
    let (network, first, second) = open_round().await;
    let update = weights(1);
    let (_sender, _uploading) = silent_after(&network, &first, &update, 3000).await;
    let request = first.upload_request(&network.genesis.network_id(), 0, &update);
    let forged = Signed::new(request, &second.key);
    refused(
        first.held(&network, &forged).await,
        Code::Unauthenticated,
        "signature",
    );
    let stranger = SigningNode::new(9);
    let request = signed(&network, &stranger, &update);
    refused(
        stranger.held(&network, &request).await,
        Code::PermissionDenied,
        "not enrolled",
    );
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_whose_round_ends_is_told_so() -> Test {
    let (network, first, _) = open_round().await;
    let update = weights(1);
    let (_sender, uploading) = silent_after(&network, &first, &update, 3000).await;
    until_async("something has come", async || network.uploads() > 0).await;
    network.clock.advance(COMMIT_MS + 1);
    network.settle().await;
    assert!(network.round(Some(0)).await.closed.is_some());
    let told = timeout(Duration::from_secs(10), uploading).await??;
    refused(told, Code::FailedPrecondition, "round 0");
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_round_closes_although_its_uploads_cannot_be_removed() -> Test {
    let (network, first, second) = open_round().await;
    let unlike = network.dir.path().join("uploads/no-folder");
    first.upload(&network, 0, &weights(1)).await?;
    std::fs::write(&unlike, "nobody can remove this as a folder")?;
    network.clock.advance(COMMIT_MS + 1);
    network.settle().await;
    assert!(network.round(Some(0)).await.closed.is_some());
    assert!(unlike.exists());
    // What is left of an ended round goes with the next one.
    std::fs::remove_file(&unlike)?;
    committed(&network, &second, 1, 2).await;
    network.drawn().await;
    network.clock.advance(SUBMIT_MS + 1);
    network.settle().await;
    assert!(network.round(Some(1)).await.closed.is_some());
    assert_eq!(network.uploads(), 0);
    Ok(())
}
