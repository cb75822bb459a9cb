//! Downloads that nobody reads, or too slowly. Each holds an open file, and strangers have a bounded share of these.

use super::{network, with};
use crate::Test;
use std::time::Duration;
use tokio::time::{sleep, timeout};
use tonic::transport::Channel;
use tonic::{Code, Status, Streaming};
use zk0_aggregator::{ConnectionLimits, Limits};
use zk0_protocol::request_head::Method;
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::federation_client::FederationClient;
use zk0_testkit::aggregator::*;
use zk0_testkit::until_async;

/// Reads what is left, with a pause after each part. Returns how many bytes came, and how it ended.
async fn read(mut stream: Streaming<proto::Chunk>, pause: Duration) -> (u64, Result<(), Status>) {
    let mut bytes = 0;
    loop {
        match stream.message().await {
            Ok(Some(chunk)) => bytes += chunk.data.len() as u64,
            Ok(None) => return (bytes, Ok(())),
            Err(status) => return (bytes, Err(status)),
        }
        sleep(pause).await;
    }
}

/// Waits until a stranger may download once more.
async fn gets_a_place(stranger: &mut FederationClient<Channel>, request: &proto::DownloadRequest) {
    let downloads = async || match stranger.download(request.clone()).await {
        Ok(_) => true,
        Err(status) => {
            assert_eq!(status.code(), Code::Unavailable, "{status}");
            false
        }
    };
    until_async("a stranger gets a place", downloads).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_downloads_while_strangers_have_all_their_downloads() -> Test {
    // So strangers have two downloads at once, and nodes fourteen.
    let (network, [node, _]) = with(ConnectionLimits {
        most: 16,
        ..ConnectionLimits::default()
    })
    .await;
    let request = network.long_download();
    let mut stranger = network.slow_reader().await;
    let first = stranger.download(request.clone()).await?;
    let _second = stranger.download(request.clone()).await?;
    let third = stranger.download(request.clone()).await;
    refused(third, Code::Unavailable, "ask again later");

    let blob = &request.blob;
    let signed = network.request(&node.key, Method::Download, None, blob, request.clone());
    let download = network.client().await.download(signed).await?.into_inner();
    let (bytes, ended) = read(download, Duration::ZERO).await;
    ended?;
    assert_eq!(bytes, LONG_BYTES);

    // A download whose reader has left makes room.
    drop(first);
    // The other one, which nobody reads, makes room after half a minute.
    let place = gets_a_place(&mut stranger, &request);
    timeout(Duration::from_secs(20), place).await?;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_download_ends_in_time_and_goes_on_where_it_was_cut() -> Test {
    let (network, _) = network(Limits {
        download: Duration::from_secs(1),
        ..Limits::default()
    })
    .await;
    let mut request = network.long_download();
    let mut reader = network.slow_reader().await;
    let download = reader.download(request.clone()).await?.into_inner();
    let (first, ended) = read(download, Duration::from_millis(50)).await;
    refused(
        ended,
        Code::DeadlineExceeded,
        "taking the file took more than 1000 ms",
    );
    assert!(first > 0 && first < LONG_BYTES, "{first} bytes");
    // A busy machine may not get all the rest in time. Then it is cut again.
    let mut begins = first;
    while begins < LONG_BYTES {
        request.begins = begins;
        let download = reader.download(request.clone()).await?.into_inner();
        let (more, ended) = read(download, Duration::ZERO).await;
        begins += more;
        match ended {
            Ok(()) => break,
            Err(status) => assert_eq!(status.code(), Code::DeadlineExceeded, "{status}"),
        }
        assert!(more > 0, "nothing came");
    }
    assert_eq!(begins, LONG_BYTES);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_reader_that_pauses_for_too_long_is_told_so() -> Test {
    let (network, _) = network(Limits {
        silence: Duration::from_millis(300),
        // So strangers have one download at once.
        connections: ConnectionLimits {
            most: 8,
            ..ConnectionLimits::default()
        },
        ..Limits::default()
    })
    .await;
    let request = network.long_download();
    let mut reader = network.slow_reader().await;
    let download = reader.download(request.clone()).await?.into_inner();
    // The aggregator gives it up, and lets somebody else have its place.
    gets_a_place(&mut network.slow_reader().await, &request).await;
    let (bytes, ended) = read(download, Duration::ZERO).await;
    refused(
        ended,
        Code::DeadlineExceeded,
        "taking its next part took more than 300 ms",
    );
    assert!(bytes < LONG_BYTES, "{bytes} bytes");
    Ok(())
}
