//! Crowds that ask for what is only in the store, and leave or wait. They hold nobody else.

use super::{answers_at_once, emptied, started, started_with, AT_ONCE, SECONDS};
use std::future::pending;
use std::net::SocketAddr;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;
use tokio::time::timeout;
use tonic::transport::Channel;
use tonic::{Code, Status};
use zk0_aggregator::publish::http::{self, HttpLimits};
use zk0_aggregator::publish::log_server::LogServer;
use zk0_aggregator::{ConnectionLimits, Limits};
use zk0_circuits::Digest;
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::federation_client::FederationClient;
use zk0_testkit::aggregator::*;
use zk0_testkit::s3::failing_network::Fault;
use zk0_testkit::s3::S3;
use zk0_testkit::until_async;

/// Begins four downloads on one connection.
pub(super) fn four(
    client: &FederationClient<Channel>,
    blob: Digest,
    downloads: &mut JoinSet<Result<(), Status>>,
) {
    for _ in 0..4 {
        let (mut client, blob) = (client.clone(), blob.0.to_vec());
        downloads.spawn(async move {
            let request = proto::DownloadRequest { blob, begins: 0 };
            client.download(request).await.map(drop)
        });
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn downloads_whose_callers_have_left_hold_no_turns() {
    let Some(s3) = S3::start() else { return };
    let node = SigningNode::new(1);
    let limits = Limits {
        // So 16 requests may be in progress, on all connections together.
        connections: ConnectionLimits {
            most: 4,
            ..ConnectionLimits::default()
        },
        ..Limits::default()
    };
    let network = started_with(&s3, &[&node], genesis(), limits, SECONDS).await;
    emptied(&network);
    s3.network.fail_always(Fault::Silent);
    for _ in 0..10 {
        let client = network.client().await;
        let mut downloads = JoinSet::new();
        four(&client, network.genesis.initial.blob, &mut downloads);
        network.in_progress("Download", 4).await;
        downloads.shutdown().await;
        network.in_progress("Download", 0).await;
    }
    answers_at_once(&network).await;
    s3.network.mend();
    // A stranger has one place for downloads here. Those whose callers have left get it, too, when the store answers them, but for a moment.
    let base = until_async("a download gets the place", async || {
        match network.download(network.genesis.initial.blob).await {
            Err(status) if status.code() == Code::Unavailable => None,
            base => Some(base),
        }
    });
    assert!(base.await.unwrap() == weights(0));
}

#[tokio::test(flavor = "multi_thread")]
async fn few_downloads_wait_for_the_store_and_the_others_are_told_to_come_again() {
    let Some(s3) = S3::start() else { return };
    let network = started(&s3, &SigningNode::new(1), SECONDS).await;
    emptied(&network);
    s3.network.fail_always(Fault::Silent);
    let mut downloads = JoinSet::new();
    for _ in 0..25 {
        let client = network.client().await;
        four(&client, network.genesis.initial.blob, &mut downloads);
    }
    // Who waits in vain for the store hears something else than who is sent away.
    for _ in 0..100 - 8 - 64 {
        let ended = timeout(Duration::from_secs(15), downloads.join_next()).await;
        let ended = ended.expect("nobody is sent away").unwrap();
        refused(ended.unwrap(), Code::Unavailable, "ask again later");
    }
    // All others have come. If one more of them were sent away, it would know that before this is answered.
    network.in_progress("Download", 8 + 64).await;
    answers_at_once(&network).await;
    let more = downloads.try_join_next();
    assert!(more.is_none(), "{more:?}");
    // When those who wait have left, there is room again.
    downloads.shutdown().await;
    network.in_progress("Download", 0).await;
    s3.network.mend();
    let base = network.download(network.genesis.initial.blob).await;
    assert!(base.unwrap() == weights(0));
}

/// Serves the log of a network.
pub(super) async fn log_of(network: &Network) -> SocketAddr {
    let blobs = network
        .service()
        .with(|aggregator| Ok(aggregator.ledger().blobs().clone()));
    let server = LogServer::new(network.dir.path()).with_blobs(blobs.await.unwrap());
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let log = listener.local_addr().unwrap();
    let limits = HttpLimits::default();
    tokio::spawn(http::serve(
        listener,
        server.router(limits),
        limits,
        pending(),
    ));
    log
}

/// Asks for a file of the log.
pub(super) async fn asking(log: SocketAddr, path: &str) -> TcpStream {
    asking_by(log, "GET", path).await
}

async fn asking_by(log: SocketAddr, method: &str, path: &str) -> TcpStream {
    let mut stream = TcpStream::connect(log).await.unwrap();
    let request = format!("{method} /{path} HTTP/1.1\r\nhost: x\r\nconnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).await.unwrap();
    stream
}

/// What the log answers.
async fn answer(mut stream: TcpStream) -> String {
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await.unwrap();
    answer
}

/// Otherwise strangers would have the aggregator read whole files, and send nothing for them.
#[tokio::test(flavor = "multi_thread")]
async fn the_size_of_a_file_is_told_without_the_store() {
    let Some(s3) = S3::start() else { return };
    let network = started(&s3, &SigningNode::new(1), SECONDS).await;
    let log = log_of(&network).await;
    emptied(&network);
    s3.network.fail_always(Fault::Silent);
    let path = format!("blobs/sha256/{}", network.genesis.initial.blob);
    let size = weights(0).len();
    for (path, expected) in [
        (&path, format!("content-length: {size}\r\n")),
        (
            &format!("blobs/sha256/{}", Digest([9; 32])),
            "HTTP/1.1 404".into(),
        ),
    ] {
        let told = answer(asking_by(log, "HEAD", path).await);
        let told = timeout(AT_ONCE, told).await.expect("nothing came");
        assert!(told.contains(&expected), "{told}");
        assert!(told.ends_with("\r\n\r\n"), "{told}");
    }
    s3.network.mend();
}

/// Here, the machine has few threads for reading the disk.
#[test]
fn readers_of_the_log_who_have_left_hold_no_threads() {
    let Some(s3) = S3::start() else { return };
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    let runtime = runtime
        .enable_all()
        .max_blocking_threads(24)
        .build()
        .unwrap();
    runtime.block_on(async {
        let network = started(&s3, &SigningNode::new(1), SECONDS).await;
        let log = log_of(&network).await;
        let answers = async || {
            let answer = timeout(AT_ONCE, answer(asking(log, "checkpoint").await));
            let answer = answer.await.expect("nothing came");
            assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
        };
        answers().await;
        emptied(&network);
        s3.network.fail_always(Fault::Silent);
        let path = format!("blobs/sha256/{}", network.genesis.initial.blob);
        for _ in 0..5 {
            let mut readers = Vec::new();
            for _ in 0..8 {
                readers.push(asking(log, &path).await);
            }
            // The log takes whoever comes first.
            answers().await;
        }
        answers_at_once(&network).await;
        // Those who stay wait, up to a number.
        let mut readers = JoinSet::new();
        for _ in 0..8 + 64 + 1 {
            readers.spawn(answer(asking(log, &path).await));
        }
        let sent_away = timeout(AT_ONCE, readers.join_next()).await;
        let text = sent_away.expect("nothing came").unwrap().unwrap();
        assert!(text.starts_with("HTTP/1.1 503"), "{text}");
        assert!(text.contains("retry-after: 5"), "{text}");
        s3.network.mend();
    });
}
