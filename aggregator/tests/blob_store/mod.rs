//! An aggregator whose blobs are kept in a bucket of a real S3 server, behind a network that fails.

mod crowds;
mod entries;
mod presigned;
mod pruning;
mod streaming;

use std::fs;
use std::time::{Duration, Instant};
use tokio::task::JoinSet;
use tonic::Code;
use zk0_aggregator::{Config, Limits, Polled};
use zk0_ledger::blobs::Blobs;
use zk0_ledger::bucket::waiting::RetryPeriod;
use zk0_ledger::bucket::Bucket;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::RefusalCode;
use zk0_testkit::aggregator::*;
use zk0_testkit::s3::failing_network::Fault;
use zk0_testkit::s3::S3;
use zk0_testkit::until_async;
use zk0_verifier::blob_digest;

const CONFIG: Config = Config {
    rounds: None,
    min_nodes: 1,
};

/// For how many seconds a request waits for a store that does not answer.
const SECONDS: u64 = 6;

/// So soon comes an answer that does not wait for the store.
const AT_ONCE: Duration = Duration::from_secs(SECONDS / 2);

/// A network whose blobs are kept in the bucket, from its founding on.
async fn started(s3: &S3, node: &SigningNode, seconds: u64) -> Network {
    started_as(s3, &[node], genesis(), seconds).await
}

/// The network of `genesis` with these nodes.
async fn started_as(s3: &S3, nodes: &[&SigningNode], genesis: Genesis, seconds: u64) -> Network {
    started_with(s3, nodes, genesis, Limits::default(), seconds).await
}

/// The same under these limits.
async fn started_with(
    s3: &S3,
    nodes: &[&SigningNode],
    genesis: Genesis,
    limits: Limits,
    seconds: u64,
) -> Network {
    let config = Config {
        min_nodes: nodes.len(),
        ..CONFIG
    };
    let mut network = Network::start_as(nodes, config, limits, genesis, None, None).await;
    network.stop().await;
    let (address, variables) = (s3.address("net"), s3.variables());
    network.keep_blobs(move |dir| {
        let bucket = Bucket::open(
            &address,
            &variables,
            RetryPeriod(Duration::from_secs(seconds)),
        );
        Blobs::in_store(dir, Box::new(bucket.unwrap())).unwrap()
    });
    network.start_again().await;
    network
}

fn emptied(network: &Network) {
    fs::remove_dir_all(network.dir.path().join("blobs")).unwrap();
}

/// How long a request takes that has nothing to do with the store.
async fn answers_at_once(network: &Network) {
    let begun = Instant::now();
    network.round(None).await;
    assert!(begun.elapsed() < AT_ONCE, "{:?}", begun.elapsed());
}

/// The same once somebody waits for the store.
async fn answers_while_the_store_is_asked(network: &Network, s3: &S3) {
    until_async("the store is asked", async || s3.network.counted("") > 0).await;
    answers_at_once(network).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_commitment_is_recorded_only_when_its_update_is_in_the_store() {
    let Some(s3) = S3::start() else { return };
    let node = SigningNode::new(1);
    let network = started(&s3, &node, SECONDS).await;
    node.register(&network).await.unwrap();
    network.settle().await;
    let update = weights(7);
    node.upload(&network, 0, &update).await.unwrap();
    let before = network.entries().await.len();
    for fault in [Fault::Unavailable, Fault::Silent] {
        s3.network.fail_always(fault);
        let begun = Instant::now();
        let (committed, ()) = tokio::join!(
            node.commit(&network, 0, &update),
            answers_while_the_store_is_asked(&network, &s3)
        );
        refused(committed, Code::Unavailable, "blob store does not answer");
        assert!(begun.elapsed() < Duration::from_secs(40), "{fault:?}");
        assert_eq!(network.entries().await.len(), before);
        assert!(!network
            .dir
            .path()
            .join("blobs/sha256")
            .join(blob_digest(&update).to_string())
            .exists());
    }
    s3.network.mend();
    node.commit(&network, 0, &update).await.unwrap();
    let stored = fs::read(s3.file("net", blob_digest(&update))).unwrap();
    assert!(stored == update);
    let entries = network.entries().await;
    let committed = entries
        .iter()
        .filter(|entry| matches!(entry.body, Body::UpdateCommitted(_)));
    assert_eq!(committed.count(), 1);
}

/// Everything is read from the store again: what a round starts from, what nodes download, and what is judged.
#[tokio::test(flavor = "multi_thread")]
async fn an_aggregator_goes_on_when_its_folder_of_blobs_is_lost() {
    let Some(s3) = S3::start() else { return };
    let node = SigningNode::new(1);
    let mut network = started(&s3, &node, 10).await;
    node.register(&network).await.unwrap();
    emptied(&network);
    network.restart().await;
    network.settle().await;
    assert!(matches!(network.last().await, Body::RoundOpened(_)));

    committed(&network, &node, 0, 7).await;
    network.drawn().await;
    emptied(&network);
    network.restart().await;
    assert!(network.download(blob_digest(POLICY)).await.unwrap() == POLICY);
    let base = network.genesis.initial.blob;
    assert!(network.download(base).await.unwrap() == weights(0));
    let unknown = network.download(zk0_circuits::Digest([9; 32])).await;
    refused(unknown, Code::NotFound, "the ledger names no blob");

    emptied(&network);
    let claim = node.claim(&network).await;
    let reply = node.submit(&network, claim, b"not a proof").await.unwrap();
    assert!(!reply.accepted);
    // The round may have closed since.
    let entries = network.entries().await.into_iter();
    let mut reasons = entries.filter_map(|entry| match entry.body {
        Body::ContributionRejected { reason, .. } => Some(reason),
        _ => None,
    });
    let reason = reasons.next().expect("nothing was decided");
    assert!(
        matches!(
            reason,
            RefusalCode::MalformedProof | RefusalCode::InvalidProof
        ),
        "{reason}"
    );
    let proof = s3.file("net", blob_digest(b"not a proof"));
    assert!(proof.exists());
}

#[tokio::test(flavor = "multi_thread")]
async fn no_round_opens_from_weights_that_the_store_has_altered() {
    let Some(s3) = S3::start() else { return };
    let node = SigningNode::new(1);
    let mut network = started(&s3, &node, 5).await;
    let base = network.genesis.initial.blob;
    let file = s3.file("net", base);
    let right = fs::read(&file).unwrap();
    let mut wrong = right.clone();
    wrong[right.len() / 2] ^= 1;
    fs::write(&file, &wrong).unwrap();
    emptied(&network);
    network.restart().await;
    node.register(&network).await.unwrap();
    let blocked = network.service().step().await.unwrap();
    let Polled::Blocked(why) = blocked else {
        panic!("{blocked:?}");
    };
    assert!(why.contains("the next round cannot open"), "{why}");
    assert!(why.contains(&format!("does not hold blob {base}")), "{why}");
    refused(
        network.download(base).await,
        Code::Internal,
        "the aggregator failed",
    );
    fs::write(&file, &right).unwrap();
    network.settle().await;
    assert!(matches!(network.last().await, Body::RoundOpened(_)));
}

/// Downloads that wait for the store hold nobody else, however many they are. Here, the machine has few threads for reading the disk.
#[test]
fn a_store_that_is_silent_holds_only_who_needs_it() {
    let Some(s3) = S3::start() else { return };
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    let runtime = runtime
        .enable_all()
        .max_blocking_threads(24)
        .build()
        .unwrap();
    runtime.block_on(async {
        let node = SigningNode::new(1);
        let network = started(&s3, &node, SECONDS).await;
        node.register(&network).await.unwrap();
        network.settle().await;
        let base = network.genesis.initial.blob;
        emptied(&network);
        s3.network.fail_always(Fault::Silent);
        let mut downloads = JoinSet::new();
        for _ in 0..40 {
            let mut client = network.client().await;
            let blob = base.0.to_vec();
            downloads.spawn(async move {
                let request = proto::DownloadRequest { blob, begins: 0 };
                client.download(request).await.map(drop)
            });
        }
        network.in_progress("Download", 40).await;
        answers_at_once(&network).await;
        // They end in bounded time, and nothing is left of them.
        s3.network.mend();
        while let Some(ended) = downloads.join_next().await {
            if let Err(status) = ended.unwrap() {
                refused::<()>(Err(status), Code::Unavailable, "blob store does not answer");
            }
        }
        assert!(network.download(base).await.unwrap() == weights(0));
    });
}

/// A bounded folder holds what the open round needs, and not more.
#[tokio::test(flavor = "multi_thread")]
async fn a_bounded_folder_holds_what_the_open_round_needs() {
    let Some(s3) = S3::start() else { return };
    let node = SigningNode::new(1);
    let mut network = started(&s3, &node, 10).await;
    network.blob_cache_bytes = Some(0);
    network.restart().await;
    node.register(&network).await.unwrap();
    network.settle().await;
    let update = committed(&network, &node, 0, 7).await;
    let blobs = Blobs::at(network.dir.path());
    let policy = blob_digest(POLICY);
    until_async("the policy goes", async || !blobs.is_here(&policy)).await;
    assert!(blobs.is_here(&network.genesis.initial.blob));
    assert!(blobs.is_here(&blob_digest(&update)));
    assert!(network.download(policy).await.unwrap() == POLICY);
}
