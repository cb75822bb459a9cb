//! Downloads of what is only in the store: they begin with the first bytes, share one reading, and end with their readers.

use super::crowds::{asking, four, log_of};
use super::{emptied, started, AT_ONCE, SECONDS};
use std::fs::{self, File};
use std::time::Duration;
use tokio::io::AsyncReadExt;
use tokio::task::JoinSet;
use tokio::time::timeout;
use tonic::{Code, Status, Streaming};
use zk0_circuits::Digest;
use zk0_ledger::bucket::PART_BYTES;
use zk0_protocol::request_head::Method;
use zk0_protocol::rpc::federation as proto;
use zk0_testkit::aggregator::*;
use zk0_testkit::s3::failing_network::Fault;
use zk0_testkit::s3::S3;
use zk0_testkit::until_async;

/// How often the store is asked for a large file.
const PARTS: usize = 5;

/// How a request for a part of a blob begins.
const PART: &str = "GET /blobs/net/blobs/";

/// How late the store is with each part.
const LATE: Duration = Duration::from_secs(1);

/// Makes the policy's file in the store a large one. Its digest is wrong, which shows only at its end.
async fn large(network: &mut Network, s3: &S3) -> Digest {
    let policy = network.genesis.policy;
    let file = File::create(s3.file("net", policy)).unwrap();
    file.set_len(PARTS as u64 * PART_BYTES).unwrap();
    network.restart().await;
    emptied(network);
    policy
}

async fn download(network: &Network, blob: Digest) -> Result<Streaming<proto::Chunk>, Status> {
    let blob = blob.0.to_vec();
    let request = proto::DownloadRequest { blob, begins: 0 };
    let download = network.client().await.download(request).await?;
    Ok(download.into_inner())
}

/// Waits until nothing is read from the store, and tells how often it was asked for a part.
async fn parts(network: &Network, s3: &S3) -> usize {
    let unfinished = network.dir.path().join("blobs/unfinished");
    let ended = async || files(&unfinished) == 0;
    until_async("the reading ends", ended).await;
    s3.network.counted(PART)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_download_begins_before_the_whole_file_is_here() {
    let Some(s3) = S3::start() else { return };
    let mut network = started(&s3, &SigningNode::new(1), SECONDS).await;
    let blob = large(&mut network, &s3).await;
    // One part comes.
    s3.network.fail_always(Fault::Silent);
    s3.network.pass_next(PART, 1);
    let begun = timeout(AT_ONCE, download(&network, blob)).await;
    let mut begun = begun.expect("nothing came").unwrap();
    let chunk = timeout(AT_ONCE, begun.message()).await;
    let chunk = chunk.expect("nothing came").unwrap().unwrap();
    assert!(!chunk.data.is_empty());
    s3.network.mend();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_of_the_log_begins_before_the_whole_file_is_here() {
    let Some(s3) = S3::start() else { return };
    let mut network = started(&s3, &SigningNode::new(1), SECONDS).await;
    let blob = large(&mut network, &s3).await;
    let log = log_of(&network).await;
    s3.network.fail_always(Fault::Silent);
    s3.network.pass_next(PART, 1);
    let mut stream = asking(log, &format!("blobs/sha256/{blob}")).await;
    let mut begin = vec![0; 1 << 20];
    let read = timeout(AT_ONCE, stream.read_exact(&mut begin)).await;
    read.expect("nothing came").unwrap();
    let head = String::from_utf8_lossy(&begin[..512]).into_owned();
    assert!(head.starts_with("HTTP/1.1 200"), "{head}");
    let length = format!("content-length: {}", PARTS as u64 * PART_BYTES);
    assert!(head.contains(&length), "{head}");
    s3.network.mend();
}

/// Otherwise strangers would have the aggregator read whole files, and take nothing of them.
#[tokio::test(flavor = "multi_thread")]
async fn a_download_that_is_cut_at_once_does_not_read_the_whole_file() {
    let Some(s3) = S3::start() else { return };
    let mut network = started(&s3, &SigningNode::new(1), SECONDS).await;
    let blob = large(&mut network, &s3).await;
    let log = log_of(&network).await;
    s3.network.fail_always(Fault::Late(LATE));
    let mut cut = download(&network, blob).await.unwrap();
    cut.message().await.unwrap().unwrap();
    drop(cut);
    let read = parts(&network, &s3).await;
    assert!(read < PARTS, "{read} parts");

    let mut cut = asking(log, &format!("blobs/sha256/{blob}")).await;
    cut.read_exact(&mut [0; 1024]).await.unwrap();
    drop(cut);
    let read = parts(&network, &s3).await;
    assert!(read < PARTS, "{read} parts");
}

#[tokio::test(flavor = "multi_thread")]
async fn readers_of_one_file_share_its_reading_until_the_last_one_leaves() {
    let Some(s3) = S3::start() else { return };
    let network = started(&s3, &SigningNode::new(1), SECONDS).await;
    let base = network.genesis.initial.blob;
    emptied(&network);
    s3.network.fail_always(Fault::Late(3 * LATE));
    let mut leaving = JoinSet::new();
    four(&network.client().await, base, &mut leaving);
    network.in_progress("Download", 4).await;
    let (whole, ()) = tokio::join!(network.download(base), async {
        network.in_progress("Download", 5).await;
        leaving.shutdown().await;
    });
    assert!(whole.unwrap() == weights(0));
    assert_eq!(parts(&network, &s3).await, 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_that_the_store_has_altered_is_never_whole() {
    let Some(s3) = S3::start() else { return };
    let network = started(&s3, &SigningNode::new(1), SECONDS).await;
    let base = network.genesis.initial.blob;
    let mut altered = weights(0);
    altered[0] ^= 1;
    fs::write(s3.file("net", base), &altered).unwrap();
    emptied(&network);
    let mut bytes = 0;
    let ended = async {
        let mut stream = download(&network, base).await?;
        while let Some(chunk) = stream.message().await? {
            bytes += chunk.data.len();
        }
        Ok(())
    };
    refused(ended.await, Code::Internal, "the aggregator failed");
    assert!(bytes < altered.len(), "{bytes} bytes");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_waits_for_the_store_where_no_stranger_has_room() {
    let Some(s3) = S3::start() else { return };
    let node = SigningNode::new(1);
    let network = started(&s3, &node, SECONDS).await;
    let base = network.genesis.initial.blob;
    emptied(&network);
    s3.network.fail_always(Fault::Silent);
    let mut strangers = JoinSet::new();
    for _ in 0..19 {
        four(&network.client().await, base, &mut strangers);
    }
    for _ in 0..4 {
        let sent_away = strangers.join_next().await.unwrap().unwrap();
        refused(sent_away, Code::Unavailable, "ask again later");
    }
    network.in_progress("Download", 8 + 64).await;
    let blob = base.0.to_vec();
    let request = proto::DownloadRequest {
        blob: blob.clone(),
        begins: 0,
    };
    let request = network.request(&node.key, Method::Download, None, &blob, request);
    let mut client = network.client().await;
    let begun = tokio::spawn(async move { client.download(request).await });
    let in_progress = "zk0_requests_in_progress{method=\"Download\"}";
    let waits = async || begun.is_finished() || network.metric(in_progress) > 8 + 64;
    until_async("the node waits, or has an answer", waits).await;
    s3.network.mend();
    strangers.shutdown().await;
    let mut download = begun.await.unwrap().unwrap().into_inner();
    let mut bytes = Vec::new();
    while let Some(chunk) = download.message().await.unwrap() {
        bytes.extend(chunk.data);
    }
    assert!(bytes == weights(0));
}
