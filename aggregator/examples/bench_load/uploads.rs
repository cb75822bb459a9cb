//! Large updates, all at once.

use crate::figures::{figure, peak_memory};
use sha2::{Digest as _, Sha256};
use std::io::Write;
use std::sync::Arc;
use std::time::Instant;
use tonic::Status;
use zk0_aggregator::{Config, Limits};
use zk0_circuits::Digest;
use zk0_protocol::entries::signed::{Signed, UploadRequest};
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::upload_chunk::Part;
use zk0_testkit::aggregator::{genesis, Network, SigningNode};

/// What a node sends at once, as `zk0 node` does.
const CHUNK: usize = 16 << 10;

pub async fn measure(count: u16, megabytes: u64) {
    let mut genesis = genesis();
    genesis.rules.max_update_bytes = megabytes * 1_000_000;
    let nodes: Vec<_> = (1..=count)
        .map(|seed| Arc::new(SigningNode::numbered(seed)))
        .collect();
    let of: Vec<&SigningNode> = nodes.iter().map(|node| &**node).collect();
    let config = Config {
        rounds: Some(1),
        min_nodes: count.into(),
    };
    let network = Network::start_as(&of, config, Limits::default(), genesis, None, None).await;
    for node in &nodes {
        node.register(&network).await.expect("registered");
    }
    network.settle().await;
    eprintln!("hashes {count} updates of {megabytes} MB …");
    let updates: Vec<_> = (1..=count)
        .map(|seed| Arc::new(Update::new(seed, megabytes * 1_000_000)))
        .collect();
    let floor = hashing_and_writing(network.dir.path(), &updates);
    eprintln!("uploads …");
    let started = Instant::now();
    let network = Arc::new(network);
    let mut uploading = tokio::task::JoinSet::new();
    for (node, update) in nodes.into_iter().zip(updates) {
        let network = network.clone();
        uploading.spawn(async move { update.upload(&network, &node).await });
    }
    let all = uploading.join_all().await;
    let seconds = started.elapsed().as_secs_f64();
    for uploaded in all {
        uploaded.expect("uploaded");
    }
    assert_eq!(network.uploads(), usize::from(count));
    figure("upload_large_updates", seconds, Some(floor), "s");
    figure("peak_memory_of_large_updates", peak_memory(), None, "MiB");
}

/// Bytes that differ from node to node, which nobody has to keep in memory.
pub struct Update {
    seed: u16,
    bytes: u64,
    digest: Digest,
}

impl Update {
    pub fn new(seed: u16, bytes: u64) -> Self {
        let mut sha = Sha256::new();
        for chunk in chunks(seed, bytes) {
            sha.update(chunk);
        }
        let digest = Digest(sha.finalize().into());
        Self {
            seed,
            bytes,
            digest,
        }
    }

    pub async fn upload(&self, network: &Network, node: &SigningNode) -> Result<(), Status> {
        let request = UploadRequest {
            network: network.genesis.network_id(),
            round: 0,
            node: node.id(),
            blob: self.digest,
            size: self.bytes,
        };
        let request = Signed::new(request, &node.key);
        let first = Part::Request(borsh::to_vec(&request).expect("in memory"));
        let data = chunks(self.seed, self.bytes).map(Part::Data);
        let parts = std::iter::once(first).chain(data);
        let parts = parts.map(|part| proto::UploadChunk {
            part: Some(part),
            begins: 0,
        });
        let request = node.uploading(network, &request, tokio_stream::iter(parts));
        network.client().await.upload(request).await?;
        Ok(())
    }
}

fn chunks(seed: u16, bytes: u64) -> impl Iterator<Item = Vec<u8>> + Send + 'static {
    let mut left = bytes as usize;
    let mut number = 0u64;
    std::iter::from_fn(move || {
        let size = left.min(CHUNK);
        left -= size;
        number += 1;
        let mut chunk = vec![seed as u8; size];
        let tag = [number.to_le_bytes(), u64::from(seed).to_le_bytes()].concat();
        let shown = size.min(tag.len());
        chunk[..shown].copy_from_slice(&tag[..shown]);
        (size > 0).then_some(chunk)
    })
}

/// Seconds for hashing the same bytes and writing them to files on the same disk, on all cores, until they are durable.
fn hashing_and_writing(folder: &std::path::Path, updates: &[Arc<Update>]) -> f64 {
    let started = Instant::now();
    let cores = std::thread::available_parallelism().map_or(1, |cores| cores.get());
    std::thread::scope(|scope| {
        for core in 0..cores {
            scope.spawn(move || {
                for update in updates.iter().skip(core).step_by(cores) {
                    let mut file = tempfile::tempfile_in(folder).expect("a file");
                    let mut sha = Sha256::new();
                    for chunk in chunks(update.seed, update.bytes) {
                        sha.update(&chunk);
                        file.write_all(&chunk).expect("written");
                    }
                    file.sync_all().expect("durable");
                    assert_eq!(sha.finalize()[..], update.digest.0);
                }
            });
        }
    });
    started.elapsed().as_secs_f64()
}
