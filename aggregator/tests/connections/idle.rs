//! Connections on which no request is in progress.

use super::relay::Counted;
use super::{network, with};
use crate::Test;
use axum::body::Body;
use std::future::poll_fn;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::time::sleep;
use tokio_stream::wrappers::ReceiverStream;
use tonic::codegen::http::{Request, Uri};
use tonic::codegen::Service;
use tonic::transport::Endpoint;
use tonic::Code;
use zk0_aggregator::{ConnectionLimits, Limits};
use zk0_protocol::entries::signed::Signed;
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::upload_chunk::Part;
use zk0_testkit::aggregator::*;
use zk0_testkit::sockets::{closes, from, speaking};

/// How long a connection may be idle.
const IDLE: Duration = Duration::from_secs(1);

fn impatient() -> ConnectionLimits {
    ConnectionLimits {
        idle: IDLE,
        ..ConnectionLimits::default()
    }
}

/// A connection comes, and is closed because it is idle. Whoever was idle before it would have been closed before it.
async fn another_one_is_idle_for_too_long(network: &Network) {
    Counted::connect(&network.address).await.ends(1).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn whoever_is_idle_is_closed_and_connects_again_by_itself() -> Test {
    let (network, _) = with(impatient()).await;
    let mut silent = speaking([1, 1], &network.address).await;
    // Nothing comes on this one.
    let mut half_open = from([1, 1], &network.address).await;
    let stranger = Counted::connect(&network.address).await;
    for connections in 1..=2 {
        stranger.asks().await;
        assert_eq!(stranger.connections(), connections);
        stranger.ends(connections).await;
    }
    assert!(closes(&mut silent, Duration::from_secs(5)).await);
    assert!(closes(&mut half_open, Duration::from_secs(5)).await);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_request_in_progress_keeps_its_connection() -> Test {
    let (network, [node, _]) = with(impatient()).await;
    node.register(&network).await?;
    network.settle().await;
    let update = weights(1);
    let request = node.upload_request(&network.genesis.network_id(), 0, &update);
    let request = Signed::new(request, &node.key);
    let part = |part| proto::UploadChunk {
        part: Some(part),
        begins: 0,
    };
    let (sender, receiver) = mpsc::channel(4);
    let first = Part::Request(borsh::to_vec(&request)?);
    sender.send(part(first)).await?;
    sender
        .send(part(Part::Data(update[..100].to_vec())))
        .await?;
    let uploader = Counted::connect(&network.address).await;
    let mut client = uploader.client.clone();
    let request = node.uploading(&network, &request, ReceiverStream::new(receiver));
    let uploading = tokio::spawn(async move { client.upload(request).await });
    network.in_progress("Upload", 1).await;
    another_one_is_idle_for_too_long(&network).await;
    sender
        .send(part(Part::Data(update[100..].to_vec())))
        .await?;
    drop(sender);
    uploading.await??;
    assert_eq!(uploader.connections(), 1);
    Ok(())
}

/// A request whose message comes byte by byte does not last.
#[tokio::test(flavor = "multi_thread")]
async fn a_message_that_trickles_is_cut() -> Test {
    let (network, _) = network(Limits {
        message: Duration::from_millis(400),
        ..Limits::default()
    })
    .await;
    let mut channel = Endpoint::try_from(network.address.clone())?
        .connect()
        .await?;
    let (sender, receiver) = mpsc::channel::<Result<Vec<u8>, std::io::Error>>(1);
    let trickling = tokio::spawn(async move {
        // A message of 100 bytes.
        let message = [0, 0, 0, 0, 100].into_iter().chain([0; 100]);
        for byte in message {
            if sender.send(Ok(vec![byte])).await.is_err() {
                break;
            }
            sleep(Duration::from_millis(50)).await;
        }
    });
    let uri: Uri = format!("{}/zk0.v1.Federation/Record", network.address).parse()?;
    let request = Request::post(uri)
        .header("content-type", "application/grpc")
        .header("te", "trailers")
        .body(tonic::body::Body::new(Body::from_stream(
            ReceiverStream::new(receiver),
        )))?;
    poll_fn(|context| channel.poll_ready(context)).await?;
    let response = channel.call(request).await?;
    let status = tonic::Status::from_header_map(response.headers()).unwrap();
    assert_eq!(status.code(), Code::DeadlineExceeded, "{status}");
    trickling.await?;
    Ok(())
}
