//! The memory for large messages is bounded, and strangers cannot take what is for nodes.

use super::network;
use crate::Test;
use axum::body::{Body, Bytes};
use std::future::poll_fn;
use std::net::IpAddr;
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, oneshot};
use tokio_stream::wrappers::ReceiverStream;
use tonic::codegen::http::Request;
use tonic::codegen::Service;
use tonic::transport::{Channel, Endpoint};
use tonic::Code;
use zk0_aggregator::{Aggregator, Limits};
use zk0_protocol::entries::signed::Signed;
use zk0_protocol::request_head::Method;
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::federation_client::FederationClient;
use zk0_protocol::rpc::federation::record_request::Statement;
use zk0_protocol::rpc::federation::upload_chunk::Part;
use zk0_testkit::aggregator::{refused, weights, Network, SigningNode};
use zk0_testkit::sockets::{begin_large_message, from};

/// A large message that the aggregator refuses after it has read it.
fn large() -> proto::RecordRequest {
    proto::RecordRequest {
        statement: Some(Statement::Body(vec![0; 3 << 20])),
        leaves: Vec::new(),
    }
}

/// The same with a head of this node.
fn large_of(network: &Network, node: &SigningNode) -> tonic::Request<proto::RecordRequest> {
    network.request(&node.key, Method::Record, None, &[], large())
}

#[tokio::test(flavor = "multi_thread")]
async fn strangers_wait_for_memory_and_nodes_do_not() -> Test {
    let message = Duration::from_secs(4);
    let (network, [node, _]) = network(Limits {
        // So there is room for one message of a stranger and for one of a node.
        message_memory: 0,
        message,
        ..Limits::default()
    })
    .await;
    let begun = Instant::now();
    let mut slow = from([1, 1], &network.address).await;
    begin_large_message(&mut slow).await;
    network.large_message().await;
    // Small requests, and large ones of nodes, are answered meanwhile.
    let mut stranger = network.client().await;
    stranger.get_network(proto::GetNetworkRequest {}).await?;
    let asked = stranger.record(large_of(&network, &node)).await;
    refused(asked, Code::InvalidArgument, "");
    assert!(begun.elapsed() < message / 2);
    // A stranger's large message waits until the slow one is cut.
    let refused = stranger.record(large()).await.unwrap_err();
    assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
    assert!(begun.elapsed() > message * 3 / 4);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn who_waits_for_memory_for_too_long_is_told_to_come_again() -> Test {
    let (network, _) = network(Limits {
        message_memory: 0,
        message: Duration::from_secs(2),
        ..Limits::default()
    })
    .await;
    // The service needs the aggregator before it takes connections, so it answers a request before the aggregator is busy.
    let mut first = network.client().await;
    first.get_network(proto::GetNetworkRequest {}).await?;
    // The aggregator is busy, so a large message keeps its memory although it has arrived.
    let service = network.service().clone();
    let (has, holds) = oneshot::channel();
    let (end, ended) = std::sync::mpsc::channel::<()>();
    let busy = tokio::spawn(async move {
        let work = move |_: &mut Aggregator| {
            let _ = has.send(());
            let _ = ended.recv();
            Ok(())
        };
        service.with(work).await
    });
    holds.await?;
    let request = proto::GetRoundRequest {
        round: None,
        node: vec![0; 3 << 20],
    };
    let waiting = tokio::spawn(async move { first.get_round(request).await });
    network.large_message().await;
    let status = network.client().await.record(large()).await.unwrap_err();
    assert_eq!(status.code(), Code::Unavailable, "{status}");
    assert!(status.message().contains("again later"), "{status}");
    drop(end);
    waiting.await??;
    busy.await??;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn an_address_sends_one_large_message_at_a_time() -> Test {
    let message = Duration::from_secs(4);
    let (network, _) = network(Limits {
        message,
        ..Limits::default()
    })
    .await;
    let begun = Instant::now();
    let mut slow = from([1, 1], &network.address).await;
    begin_large_message(&mut slow).await;
    network.large_message().await;
    let mut took = Vec::new();
    for host in [2, 1] {
        let endpoint = Endpoint::try_from(network.address.clone())?;
        let local = IpAddr::from([127, 0, 1, host]);
        let channel = endpoint.local_address(Some(local)).connect().await?;
        let mut client = FederationClient::new(channel);
        let refused = client.record(large()).await.unwrap_err();
        assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
        took.push(begun.elapsed());
    }
    let half = message / 2;
    assert!(took[0] < half && took[1] > half, "{took:?}");
    Ok(())
}

type Sender = mpsc::Sender<Result<Bytes, std::io::Error>>;

/// Begins a message of 4 MiB with a head of this node, of which one byte comes as long as the connection and the sender are there.
async fn begin_slow_message(network: &Network, node: &SigningNode) -> (Channel, Sender) {
    let endpoint = Endpoint::try_from(network.address.clone()).unwrap();
    let mut channel = endpoint.connect().await.unwrap();
    let (sender, receiver) = mpsc::channel(1);
    let begun = [&[0][..], &(4u32 << 20).to_be_bytes(), &[0]].concat();
    sender.send(Ok(begun.into())).await.unwrap();
    let body = Body::from_stream(ReceiverStream::new(receiver));
    let body = tonic::body::Body::new(body);
    let request = network.request(&node.key, Method::Submit, None, &[], body);
    let (metadata, _, body) = request.into_parts();
    let mut request = Request::new(body);
    *request.uri_mut() = format!("{}/zk0.v1.Federation/Submit", network.address)
        .parse()
        .unwrap();
    *request.method_mut() = tonic::codegen::http::Method::POST;
    *request.headers_mut() = metadata.into_headers();
    for (name, value) in [("content-type", "application/grpc"), ("te", "trailers")] {
        request.headers_mut().insert(name, value.parse().unwrap());
    }
    poll_fn(|context| channel.poll_ready(context))
        .await
        .unwrap();
    let answer = channel.call(request);
    tokio::spawn(answer);
    (channel, sender)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_takes_no_memory_of_other_nodes() -> Test {
    let message = Duration::from_secs(20);
    let (network, [greedy, other]) = network(Limits {
        // So nodes have 8 MiB.
        message_memory: 16 << 20,
        message,
        ..Limits::default()
    })
    .await;
    let mut slow = Vec::new();
    for number in 1..=4 {
        slow.push(begin_slow_message(&network, &greedy).await);
        network.in_progress("Submit", number).await;
        network.large_message().await;
    }
    let begun = Instant::now();
    let request = large_of(&network, &other);
    let asked = network.client().await.record(request).await;
    refused(asked, Code::InvalidArgument, "");
    assert!(begun.elapsed() < message / 2);
    assert_eq!(slow.len(), 4);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_that_uploads_sends_a_large_message_meanwhile() -> Test {
    let (network, [node, _]) = network(Limits {
        message_memory: 0,
        ..Limits::default()
    })
    .await;
    node.register(&network).await?;
    network.settle().await;
    let update = weights(1);
    let request = node.upload_request(&network.genesis.network_id(), 0, &update);
    let request = Signed::new(request, &node.key);
    // A node sends 16 KiB of an update at a time.
    let (first, rest) = update.split_at(update.len().min(16 << 10));
    let parts = [
        Part::Request(borsh::to_vec(&request)?),
        Part::Data(first.to_vec()),
    ];
    let (sender, receiver) = mpsc::channel(4);
    let part = |part| proto::UploadChunk {
        part: Some(part),
        begins: 0,
    };
    for one in parts {
        sender.send(part(one)).await?;
    }
    let mut uploader = network.client().await;
    let uploaded = node.uploading(&network, &request, ReceiverStream::new(receiver));
    let uploading = tokio::spawn(async move { uploader.upload(uploaded).await });
    network.in_progress("Upload", 1).await;
    let begun = Instant::now();
    let request = large_of(&network, &node);
    let asked = network.client().await.record(request).await;
    refused(asked, Code::InvalidArgument, "");
    // The upload may be silent for thirty seconds.
    assert!(begun.elapsed() < Duration::from_secs(10));
    for data in rest.chunks(16 << 10) {
        sender.send(part(Part::Data(data.to_vec()))).await?;
    }
    drop(sender);
    uploading.await??;
    Ok(())
}
