//! Entries are in the bucket before they are acknowledged. Who wants one recorded waits while the bucket does not take it. Where another
//! aggregator has stored entries, nothing is recorded any more.

use super::{started, started_as, AT_ONCE};
use std::fs;
use tokio::time::timeout;
use tonic::Code;
use zk0_ledger::blobs::entry_objects::{group_name, FOLDER};
use zk0_ledger::error::LedgerError;
use zk0_ledger::stored_entries::decode;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::trouble::Kind;
use zk0_testkit::aggregator::*;
use zk0_testkit::s3::failing_network::Fault;
use zk0_testkit::s3::S3;
use zk0_testkit::until_async;

/// The requests by which an aggregator stores entries.
const STORING: &str = "PUT /blobs/net/entries/";

async fn status(network: &Network) -> proto::StatusInfo {
    let mut client = network.client().await;
    let status = client.get_status(proto::GetStatusRequest {});
    status.await.unwrap().into_inner()
}

#[tokio::test(flavor = "multi_thread")]
async fn an_entry_waits_for_the_bucket_and_the_status_shows_it() {
    let Some(s3) = S3::start() else { return };
    let node = SigningNode::new(1);
    let network = started(&s3, &node, 1).await;
    let before = network.entries().await.len();
    s3.network.fail_next(STORING, Fault::Unavailable, 1000);
    let troubles = network.service().troubles().clone();
    let is_away = || troubles.lasting(Kind::BlobStore).is_some();
    let meanwhile = async {
        until_async("the bucket is trouble", async || is_away()).await;
        let status = timeout(AT_ONCE, status(&network)).await;
        let status = status.expect("nothing came");
        assert_eq!(status.entries, before as u64);
        let kinds: Vec<_> = status.trouble.iter().map(proto::Trouble::kind).collect();
        assert_eq!(kinds, [Kind::BlobStore]);
        s3.network.mend();
    };
    let (registered, ()) = tokio::join!(node.register(&network), meanwhile);
    registered.unwrap();
    let entry = &network.entries().await[before];
    assert!(matches!(entry.body, Body::DatasetCommitted(_)));
    until_async("the trouble is over", async || !is_away()).await;
    let object = s3.root("net").join(FOLDER).join(group_name(before as u64));
    let stored = decode(&fs::read(object).unwrap()).unwrap();
    assert_eq!(Entry::decode(&stored[0].bytes).unwrap(), *entry);
}

#[tokio::test(flavor = "multi_thread")]
async fn where_another_aggregator_has_stored_entries_nothing_is_acknowledged() {
    let Some(s3) = S3::start() else { return };
    let node = SigningNode::new(1);
    let network = started(&s3, &node, 10).await;
    let before = network.entries().await.len();
    let object = s3.root("net").join(FOLDER).join(group_name(before as u64));
    fs::write(object, b"another's").unwrap();
    let registered = node.register(&network).await;
    refused(registered, Code::Internal, "the aggregator failed");
    assert_eq!(network.entries().await.len(), before);
    let writable = network
        .service()
        .with(|aggregator| Ok(aggregator.ledger().check_writable()));
    let fenced = writable.await.unwrap();
    assert!(
        matches!(fenced, Err(LedgerError::OtherEntries { index, .. }) if index == before as u64),
        "{fenced:?}"
    );
}

/// Nobody else got the aggregator meanwhile.
#[tokio::test(flavor = "multi_thread")]
async fn a_deadline_moves_by_the_time_that_the_bucket_was_away() {
    let Some(s3) = S3::start() else { return };
    let (node, other) = (SigningNode::new(1), SigningNode::new(2));
    let network = started_as(&s3, &[&node, &other], genesis(), 1).await;
    node.register(&network).await.unwrap();
    other.register(&network).await.unwrap();
    network.settle().await;
    let update = weights(1);
    node.upload(&network, 0, &update).await.unwrap();
    s3.network.fail_next(STORING, Fault::Unavailable, 1000);
    let troubles = network.service().troubles().clone();
    let is_away = || troubles.lasting(Kind::BlobStore).is_some();
    let meanwhile = async {
        until_async("the bucket is trouble", async || is_away()).await;
        network.clock.advance(2 * COMMIT_MS);
        s3.network.mend();
    };
    let (committed, ()) = tokio::join!(node.commit(&network, 0, &update), meanwhile);
    committed.unwrap();
    let Body::DeadlinesMoved(moved) = network.last().await else {
        panic!("the deadline has not moved");
    };
    assert_eq!(moved.by_ms, 2 * COMMIT_MS);
    other.upload(&network, 0, &weights(2)).await.unwrap();
    other.commit(&network, 0, &weights(2)).await.unwrap();
}
