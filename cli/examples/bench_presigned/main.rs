//! Measures what an aggregator saves where nodes put their updates straight into the bucket (`--presigned-uploads`). Run it with `make bench-load`.
//!
//! ```text
//! bench_presigned ZK0 NODES MEGABYTES
//! ```
//!
//! So many nodes upload updates of this size, all at once, and commit to them. The aggregator is the program ZK0, the bucket is one of an S3
//! server (`s3s-fs`) on loopback, and the nodes are this process, with the node's own client. *Ours* puts the updates into the bucket, the *peer*
//! sends them to the same aggregator without `--presigned-uploads`, which then puts them there. Prints one JSON line for each figure. `ratio` is more
//! than 1 where ours is better.
//!
//! `s3s-fs` reads a whole object whenever it is asked for a part of it, to compute its MD5, which no store does that keeps many objects. So the time
//! until large updates are with the aggregator is that server's: `s3_server_cpu` shows it.

mod aggregator;

use crate::aggregator::{Aggregator, Cost};
use serde_json::json;
use std::process::exit;
use std::time::Instant;
use tokio::task::JoinSet;
use zk0_testkit::members::Member;
use zk0_testkit::s3::S3;

/// Bytes in a megabyte.
const MB: u64 = 1_000_000;

#[tokio::main]
async fn main() {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let arguments: Vec<_> = arguments.iter().map(String::as_str).collect();
    let [program, nodes, megabytes] = arguments[..] else {
        panic!("bench_presigned ZK0 NODES MEGABYTES");
    };
    let nodes: u16 = nodes.parse().expect("a number of nodes");
    let megabytes: u64 = megabytes.parse().expect("a number of megabytes");
    let measured = (
        measure(program, nodes, megabytes, &["--presigned-uploads"]).await,
        measure(program, nodes, megabytes, &[]).await,
    );
    let (Some(ours), Some(peer)) = measured else {
        eprintln!("there is no S3 server: scripts/setup.sh guest installs it");
        exit(2);
    };
    let of = format!("{nodes}_updates_of_{megabytes}_mb");
    for (bench, figure, unit) in [
        ("upload", (|cost| cost.upload) as fn(&Cost) -> f64, "s"),
        ("commit", |cost| cost.commit, "s"),
        ("aggregator_cpu", |cost| cost.cpu, "s"),
        ("aggregator_memory", |cost| cost.memory, "MiB"),
        ("aggregator_disk_writes", |cost| cost.written, "MB"),
        ("s3_server_cpu", |cost| cost.server_cpu, "s"),
    ] {
        let (ours, peer) = (figure(&ours), figure(&peer));
        let (bench, ratio) = (format!("{bench}_of_{of}"), peer / ours);
        println!(
            "{}",
            json!({"bench": bench, "ours": ours, "peer": peer, "ratio": ratio, "unit": unit})
        );
    }
}

/// Measures one way of uploading. `None` if there is no S3 server.
async fn measure(program: &str, count: u16, megabytes: u64, more: &[&str]) -> Option<Cost> {
    let s3 = S3::start()?;
    let members: Vec<_> = (1..=count).map(Member).collect();
    let bytes = megabytes * MB;
    let aggregator = Aggregator::start(program, &s3, &members, bytes, more);
    let mut joined = Vec::new();
    for member in members {
        let node = member.join(&aggregator.address, aggregator.network).await;
        joined.push((member, node));
    }
    for (_, node) in &mut joined {
        node.wait_for_round(0).await.expect("the first round");
    }
    eprintln!("makes {count} updates of {megabytes} MB …");
    let joined: Vec<_> = joined
        .into_iter()
        .map(|(member, node)| (member, node, member.update(bytes as usize)))
        .collect();
    let way = match more {
        [] => "through the aggregator",
        _ => "straight into the bucket",
    };
    eprintln!("uploads {way} …");
    let begun = Instant::now();
    let mut uploading = JoinSet::new();
    for (member, mut node, update) in joined {
        uploading.spawn(async move {
            let blob = member.upload(&mut node, update).await.expect("uploaded");
            (member, node, blob)
        });
    }
    let uploaded = uploading.join_all().await;
    let upload = begun.elapsed().as_secs_f64();
    let begun = Instant::now();
    let mut committing = JoinSet::new();
    for (member, mut node, blob) in uploaded {
        committing.spawn(async move {
            member.commit(&mut node, blob).await.expect("committed");
            blob
        });
    }
    let committed = committing.join_all().await;
    let commit = begun.elapsed().as_secs_f64();
    for blob in committed {
        let stored = s3.file("net", blob).metadata().expect("in the bucket");
        assert_eq!(stored.len(), bytes);
    }
    let from = match more {
        [] => "message",
        _ => "store",
    };
    assert_eq!(aggregator.came_from(from), f64::from(count));
    Some(aggregator.cost(upload, commit, &s3))
}
