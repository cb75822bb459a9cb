//! Readers of the log's files who need long, or come again for what is missing.

use super::with;
use crate::Test;
use std::future::pending;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use zk0_aggregator::publish::http::{self, HttpLimits};
use zk0_aggregator::publish::log_server::LogServer;
use zk0_aggregator::ConnectionLimits;
use zk0_ledger::blobs::Blobs;
use zk0_testkit::aggregator::*;

/// Serves the log of `network` with these limits. Returns the path of a blob of [`LONG_BYTES`], and a connection that takes little of it ahead.
async fn served(network: &Network, limits: HttpLimits) -> (String, TcpStream) {
    network.long_download();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let router = LogServer::new(network.dir.path()).router(limits);
    tokio::spawn(http::serve(listener, router, limits, pending()));
    let socket = TcpSocket::new_v4().unwrap();
    socket.set_recv_buffer_size(64 << 10).unwrap();
    let stream = socket.connect(address).await.unwrap();
    let path = format!("/blobs/sha256/{}", network.genesis.policy);
    (path, stream)
}

/// Sends a request for `path` with this header.
async fn ask(stream: &mut TcpStream, path: &str, header: &str) {
    let request = format!("GET {path} HTTP/1.1\r\nhost: x\r\n{header}\r\n\r\n");
    stream.write_all(request.as_bytes()).await.unwrap();
}

/// The head of the next answer.
async fn head(stream: &mut TcpStream) -> String {
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        head.push(stream.read_u8().await.unwrap());
    }
    String::from_utf8(head).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_reader_takes_the_rest_of_a_file() -> Test {
    let (network, _) = with(ConnectionLimits::default()).await;
    let (path, mut stream) = served(&network, HttpLimits::default()).await;
    let file = std::fs::read(Blobs::at(network.dir.path()).path(&network.genesis.policy))?;
    let size = file.len();

    ask(&mut stream, &path, "range: bytes=100000-").await;
    let reported = head(&mut stream).await;
    assert!(reported.starts_with("HTTP/1.1 206"), "{reported}");
    let range = format!("content-range: bytes 100000-{}/{size}", size - 1);
    assert!(reported.contains(&range), "{reported}");
    assert!(reported.contains("accept-ranges: bytes"), "{reported}");
    let mut rest = vec![0; size - 100_000];
    stream.read_exact(&mut rest).await?;
    assert!(rest == file[100_000..]);

    ask(&mut stream, &path, &format!("range: bytes={size}-")).await;
    let reported = head(&mut stream).await;
    assert!(reported.starts_with("HTTP/1.1 416"), "{reported}");
    let range = format!("content-range: bytes */{size}");
    assert!(reported.contains(&range), "{reported}");
    let why = format!("the file has {size} bytes, and no byte {size}\n");
    let mut text = vec![0; why.len()];
    stream.read_exact(&mut text).await?;
    assert_eq!(String::from_utf8(text)?, why);

    // A tile is a file, too. What changes has no rest.
    ask(&mut stream, "/tile/entries/000.p/1", "range: bytes=1-").await;
    let reported = head(&mut stream).await;
    assert!(reported.starts_with("HTTP/1.1 206"), "{reported}");
    let length = reported.split("content-length: ").nth(1).unwrap();
    let length = length.split("\r\n").next().unwrap().parse::<usize>()?;
    let mut tile = vec![0; length];
    stream.read_exact(&mut tile).await?;
    let header = "range: bytes=1-\r\nconnection: close";
    ask(&mut stream, "/checkpoint", header).await;
    let reported = head(&mut stream).await;
    assert!(reported.starts_with("HTTP/1.1 200"), "{reported}");
    Ok(())
}
