//! An upload and a download over a line like those between homes and data centres: so many bits a second, and so long a round trip. The
//! peer is a plain TCP connection over the same line.

use crate::figures::figure;
use crate::uploads::Update;
use std::fs::File;
use std::time::{Duration, Instant};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio::time::sleep_until;
use zk0_aggregator::{Config, Limits};
use zk0_circuits::Digest;
use zk0_ledger::blobs::Blobs;
use zk0_protocol::rpc::federation::DownloadRequest;
use zk0_testkit::aggregator::{genesis, Network, SigningNode};

/// Bits a second, in either direction.
const LINE: f64 = 100e6;

/// From one end to the other and back.
const ROUND_TRIPS: [Duration; 2] = [Duration::from_millis(20), Duration::from_millis(100)];

/// What is read from a connection at once, in bytes.
const READ: usize = 64 << 10;

/// The shortest wait: the clock of timers is no finer than a fifth of it.
const WAIT: Duration = Duration::from_millis(5);

pub async fn measure(megabytes: u64) {
    let bytes = megabytes * 1_000_000;
    let mut genesis = genesis();
    genesis.rules.max_update_bytes = bytes;
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    for round_trip in ROUND_TRIPS {
        let node = SigningNode::numbered(1);
        let limits = Limits::default();
        let mut network =
            Network::start_as(&[&node], config, limits, genesis.clone(), None, None).await;
        node.register(&network).await.expect("registered");
        network.settle().await;
        network.address = line_to(&network.address, round_trip).await;
        let floor = plain(bytes, round_trip).await;
        let print = |what, started: Instant| {
            let at = format!("at_100_Mbit/s_and_{}_ms", round_trip.as_millis());
            let name = format!("{what}_of_{megabytes}_MB_{at}");
            figure(&name, started.elapsed().as_secs_f64(), Some(floor), "s");
        };
        let update = Update::new(1, bytes);
        let started = Instant::now();
        update.upload(&network, &node).await.expect("uploaded");
        print("upload", started);
        // The policy is a blob that everybody may have, and this one has as many bytes.
        let policy = network.genesis.policy;
        let file = Blobs::at(network.dir.path()).path(&policy);
        let file = File::options().write(true).open(file).expect("the policy");
        file.set_len(bytes).expect("a larger file");
        let started = Instant::now();
        assert_eq!(downloaded(&network, &policy).await, bytes);
        print("download", started);
    }
}

/// Downloads a blob, and gives how many bytes came.
async fn downloaded(network: &Network, blob: &Digest) -> u64 {
    let request = DownloadRequest {
        blob: blob.0.to_vec(),
        begins: 0,
    };
    let answer = network.client().await.download(request).await;
    let (mut chunks, mut bytes) = (answer.expect("an answer").into_inner(), 0);
    while let Some(chunk) = chunks.message().await.expect("a part") {
        bytes += chunk.data.len() as u64;
    }
    bytes
}

/// Seconds in which a plain TCP connection takes as many bytes over the line, and brings the answer that they have come.
async fn plain(bytes: u64, round_trip: Duration) -> f64 {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let service = listener.local_addr().expect("its address").to_string();
    tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.expect("a connection");
        let mut buffer = vec![0; READ];
        let mut left = bytes;
        while left > 0 {
            left -= stream.read(&mut buffer).await.expect("bytes") as u64;
        }
        stream.write_all(b"!").await.expect("answered");
    });
    let near = line_to(&service, round_trip).await;
    let near = near.trim_start_matches("http://");
    let mut stream = TcpStream::connect(near).await.expect("a connection");
    let started = Instant::now();
    let buffer = vec![0; READ];
    let mut left = bytes as usize;
    while left > 0 {
        let part = left.min(READ);
        stream.write_all(&buffer[..part]).await.expect("sent");
        left -= part;
    }
    stream.read_u8().await.expect("an answer");
    started.elapsed().as_secs_f64()
}

/// Listens at one end of a line, whose other end is the service at `address`.
async fn line_to(address: &str, round_trip: Duration) -> String {
    let far = address.trim_start_matches("http://").to_string();
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let near = listener.local_addr().expect("its address");
    tokio::spawn(async move {
        while let Ok((near, _)) = listener.accept().await {
            let far = TcpStream::connect(&far).await.expect("the service");
            near.set_nodelay(true).expect("a connection");
            far.set_nodelay(true).expect("a connection");
            let ((from_near, to_near), (from_far, to_far)) = (near.into_split(), far.into_split());
            tokio::spawn(carry(from_near, to_far, round_trip / 2));
            tokio::spawn(carry(from_far, to_near, round_trip / 2));
        }
    });
    format!("http://{near}")
}

/// Carries bytes in one direction. The line holds as many as are on their way.
async fn carry(
    mut from: impl AsyncRead + Unpin,
    mut to: impl AsyncWrite + Unpin + Send + 'static,
    delay: Duration,
) {
    let (line, mut arriving) = mpsc::unbounded_channel::<(tokio::time::Instant, Vec<u8>)>();
    tokio::spawn(async move {
        while let Some((arrives, bytes)) = arriving.recv().await {
            sleep_until(arrives).await;
            if to.write_all(&bytes).await.is_err() {
                return;
            }
        }
        let _ = to.shutdown().await;
    });
    let mut free = tokio::time::Instant::now();
    let mut buffer = vec![0; READ];
    while let Ok(count @ 1..) = from.read(&mut buffer).await {
        // The line takes the next bytes when it has sent those before.
        let now = tokio::time::Instant::now();
        free = free.max(now) + Duration::from_secs_f64(8.0 * count as f64 / LINE);
        if free > now + WAIT {
            sleep_until(free).await;
        }
        if line.send((free + delay, buffer[..count].to_vec())).is_err() {
            return;
        }
    }
}
