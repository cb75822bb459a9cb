//! The disk of an aggregator is full while a node uploads, and while it submits. The node waits, and goes on where it was when there is room.
//! `zk0-ledger` tests what a full disk does to appends and checkpoints.
//!
//! The limit of a file's size stands for the full disk. It is of the whole process, so this test has one of its own.

use rlimit::Resource;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio::signal::unix::{signal, SignalKind};
use tokio::time::timeout;
use tonic::Code;
use zk0_aggregator::Config;
use zk0_node::client::NodeClient;
use zk0_protocol::Signed;
use zk0_testkit::aggregator::{self, reason, Network, POLICY, START_MS};
use zk0_testkit::own_process::alone;

type Test = Result<(), Box<dyn std::error::Error>>;

/// A file may not grow beyond this meanwhile. That is less than the update.
const ROOM: u64 = 60_000;

/// The signal that a process gets when a file would grow beyond the limit.
const SIGXFSZ: i32 = 25;

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_and_a_submission_go_on_when_there_is_room_again() -> Test {
    let name = "full_disk::an_upload_and_a_submission_go_on_when_there_is_room_again";
    if !alone(name, &[]) {
        return Ok(());
    }
    // With a handler, the write fails, and the process goes on.
    let _ignored = signal(SignalKind::from_raw(SIGXFSZ))?;
    let (first, second) = (
        aggregator::SigningNode::new(1),
        aggregator::SigningNode::new(2),
    );
    let config = Config {
        rounds: Some(1),
        min_nodes: 2,
    };
    let network = Network::start(&[&first, &second], config).await;
    let now = SystemTime::now().duration_since(UNIX_EPOCH)?;
    network.clock.advance(now.as_millis() as u64 - START_MS);
    first.register(&network).await?;
    second.register(&network).await?;
    network.settle().await;
    let id = network.genesis.network_id();
    let mut node = NodeClient::connect(network.address.clone(), id, first.key.clone()).await?;

    let update: Vec<u8> = (0..POLICY.len()).map(|at| (at % 241) as u8).collect();
    let size = update.len() as u64;
    assert!(size > 2 * ROOM);
    let (soft, hard) = Resource::FSIZE.get()?;
    Resource::FSIZE.set(ROOM, hard)?;
    let request = first.upload_request(&id, 0, &update);
    let request = Signed::new(request, &first.key);
    let mut uploading = tokio::spawn(async move { node.upload(0, update).await });
    assert!(timeout(Duration::from_secs(3), &mut uploading)
        .await
        .is_err());
    assert_eq!(first.held(&network, &request).await?, ROOM);
    Resource::FSIZE.set(soft, hard)?;
    timeout(Duration::from_secs(20), uploading).await???;
    assert_eq!(first.held(&network, &request).await?, size);

    aggregator::committed(&network, &second, 0, 1).await;
    network.drawn().await;
    let (claim, proof) = (second.claim(&network).await, [0; ROOM as usize + 1]);
    Resource::FSIZE.set(ROOM, hard)?;
    aggregator::refused(
        second.submit(&network, claim.clone(), &proof).await,
        Code::Unavailable,
        "disk is full",
    );
    Resource::FSIZE.set(soft, hard)?;
    let reason = reason(&second.submit(&network, claim, &proof).await?);
    assert!(reason.contains("not an SP1 compressed proof"), "{reason}");
    Ok(())
}
